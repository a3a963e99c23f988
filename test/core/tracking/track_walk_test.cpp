#include "vi_ekf_slam/core/tracking/track_walk.hpp"

#include <vector>

#include "../road.hpp"
#include "view.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

constexpr double kWalk = 0.5; // px/s^0.5

/// Three tracks seen again: the first walks, the second stays, the third walks but was found again.
struct Walked {
  Walked() : view(0.3, 1, 3), before(view.filter.covariance()) {
    StereoFrame frame =
        view.frameOf([&](FeatureId, const Eigen::Vector3d& p) { return camera().project(p); });
    frame.features[0].walk = frame.features[2].walk = kWalk;
    view.map.active(2).reactivated = true;
    letTracksWalk(view.filter, view.map, view.model, frame, {{0, 0}, {1, 1}, {2, 2}}, kSeconds);
  }

  const StereoCamera& camera() const { return view.model.rig().camera; }
  /// Of the landmark's pixels, px^2.
  Eigen::Matrix4d grownBy(std::size_t landmark) const {
    const Handle variable = view.map.active()[landmark].variable;
    const Eigen::Index row = view.filter.rowOf(variable);
    const SE3 cam_T_world = view.model.camTWorld(view.filter);
    const Eigen::Matrix<double, 4, 3> J =
        camera().projectJacobian(cam_T_world * view.filter.variables().point(variable)) *
        cam_T_world.rotation();
    return J * (view.filter.covariance() - before).block<3, 3>(row, row) * J.transpose();
  }

  static constexpr double kSeconds = 0.2;
  View view;
  Eigen::MatrixXd before;
};

TEST(TrackWalk, MovesWhatATrackShowsAlikeInBothImages) {
  const Walked walked;
  const double variance = kWalk * kWalk * Walked::kSeconds;
  Eigen::Matrix4d expected = variance * Eigen::Matrix4d::Identity();
  expected(0, 2) = expected(2, 0) = expected(1, 3) = expected(3, 1) = variance;
  EXPECT_LT(distance(walked.grownBy(0), expected), 1e-12);
}

TEST(TrackWalk, IsNoneOfTracksThatStayAndOfLandmarksThatWereFoundAgain) {
  const Walked walked;
  EXPECT_EQ(walked.grownBy(1).cwiseAbs().maxCoeff(), 0.0);
  EXPECT_EQ(walked.grownBy(2).cwiseAbs().maxCoeff(), 0.0);
}

TEST(TrackWalk, IsOfEachTrackForItself) {
  const Walked walked;
  Eigen::MatrixXd grown = walked.view.filter.covariance() - walked.before;
  const Eigen::Index row = walked.view.filter.rowOf(walked.view.map.active()[0].variable);
  grown.block<3, 3>(row, row).setZero();
  EXPECT_EQ(grown.cwiseAbs().maxCoeff(), 0.0);
}

TEST(InvariantEstimator, TakesTheWalkThatItsTracksState) {
  const auto sigmaAfter = [](double walk) {
    InvariantEstimator estimator(steadyTracks());
    estimator.setRig(exampleRig());
    Road road(1, 30, {0.1, 0.01, 0.5});
    for (int i = 0; i < 50; ++i)
      road.feed(estimator, [&](StereoFrame& frame) {
        for (auto& feature : frame.features) feature.walk = walk;
      });
    return std::sqrt(estimator.state().pose_covariance.trace());
  };
  EXPECT_GT(sigmaAfter(2.0), 1.2 * sigmaAfter(0.0));
}

} // namespace
} // namespace vi_ekf_slam
