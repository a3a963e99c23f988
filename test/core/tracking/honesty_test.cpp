#include <cmath>
#include <vector>

#include "../road.hpp"
#include "vi_ekf_slam/core/tracking/track_walk.hpp"
#include "vi_ekf_slam/simulation/consistency.hpp"
#include "view.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

TEST(InvariantEstimator, TakesTheCovarianceOfTheSample) {
  const InvariantConfig config = steadyTracks();
  for (const double sigma : {0.01, 0.5}) {
    const Eigen::Matrix3d R = sigma * sigma * Eigen::Matrix3d::Identity();
    InvariantEstimator estimator(config);
    estimator.process(ImuSample{1, {0.1, 0.2, 0.3}, R});
    estimator.process(VelocitySample{1, {5.0, 0.2, 0.3}, R});
    const StateEstimate state = estimator.state();
    for (int i = 0; i < 6; ++i) {
      const double P = std::pow(config.motion.prior_twist_sigma[i], 2);
      const double B = std::pow(config.motion.prior_bias_sigma[i], 2);
      EXPECT_NEAR(state.twist_covariance(i, i), P - P * P / (P + B + sigma * sigma), 1e-12);
    }
    EXPECT_NEAR(state.twist[0], 5.0 * 225.0 / (225.0 + 1e-6 + sigma * sigma), 1e-6);
  }
  // Without one the configured noise holds.
  InvariantEstimator silent(config), told(config);
  silent.process(ImuSample{1, {0.1, 0.2, 0.3}, {}});
  told.process(ImuSample{1, {0.1, 0.2, 0.3}, Eigen::Matrix3d(0.0025 * Eigen::Matrix3d::Identity())});
  expectSame(silent.state(), told.state(), 1e-15);
}

TEST(InvariantEstimator, KnowsHowWrongItIs) {
  const InvariantConfig config = steadyTracks();
  double nees = 0.0;
  constexpr int kRuns = 40;
  for (unsigned run = 0; run < kRuns; ++run) {
    Road road(100 + run, 25,
              {config.motion.velocity_sigma, config.motion.gyro_sigma, config.stereo.pixel_sigma});
    const InvariantEstimator estimator = driven(road, 300, config);
    const StateEstimate state = estimator.state();
    Vector6d error;
    error << road.truth().translation() - state.world_T_imu.translation(),
        so3::Log(road.truth().rotation() * state.world_T_imu.rotation().transpose());
    nees += error.dot(inverseOf(state.pose_covariance) * error) / (6.0 * kRuns);
  }
  RecordProperty("nees_percent", static_cast<int>(100.0 * nees));
  EXPECT_GT(nees, 0.7); // 40 runs tell the mean to 0.09
  EXPECT_LT(nees, 1.35);
}

// Its first frames tell all that it knows of the twist.
TEST(InvariantEstimator, KnowsHowWrongACameraAloneIsThatBeginsInMotion) {
  for (const double speed : {2.0, 8.0, 14.0}) {
    constexpr int kRuns = 30, kFrames = 10;
    double nees = 0.0;
    for (unsigned run = 1; run <= kRuns; ++run) {
      Road road(run, 60, {0.0, 0.0, steadyTracks().stereo.pixel_sigma}, 80.0);
      road.setTwist((Vector6d() << speed, 0.1, 0.0, 0.0, 0.0, 0.15).finished());
      InvariantEstimator estimator = withRig();
      for (int i = 0; i <= kFrames; ++i) {
        estimator.process(road.frame());
        if (i > 0) nees += simulation::poseNees(road.pose(), estimator.state()).pose / (kRuns * kFrames);
        road.move();
      }
    }
    EXPECT_GT(nees, 4.0) << speed; // 30 runs tell a frame's mean to 0.6
    EXPECT_LT(nees, 8.0) << speed;
  }
}

/// Draws from the view's own covariance where the body and each landmark truly are, and how they are seen.
class Truths {
 public:
  Truths(const View& view, unsigned seed) : view_(view), random_(seed) {
    const Eigen::MatrixXd P = view.filter.covariance();
    root_ = P.llt().matrixL();
  }

  /// p = p^ + dp, R = Exp(theta) R^, x - p = Exp(theta) (x^ - p^ + y). Each track has walked for a tenth of a
  /// second (px/s^0.5).
  StereoFrame frame(double walk = 0.0) {
    const Filter& filter = view_.filter;
    const Eigen::VectorXd error = root_ * normal(root_.rows());
    const Eigen::Matrix3d turn = so3::Exp(error.segment<3>(3));
    const Eigen::Vector3d before = filter.pose().translation(), p = before + error.head<3>();
    const SE3 pose(turn * filter.pose().rotation(), p);
    StereoFrame frame;
    for (const Landmark& l : view_.map.active()) {
      const Eigen::Vector3d y = error.segment<3>(filter.rowOf(l.variable));
      const Eigen::Vector3d x = p + turn * (filter.variables().point(l.variable) - before + y);
      // Of the four coordinates, whose mean of both rows has half the variance.
      Eigen::VectorXd noise = std::sqrt(view_.model.noise()(0, 0)) * normal(4);
      if (walk > 0.0) noise += walk * std::sqrt(0.1) * normal(2).replicate<2, 1>();
      const StereoRig& rig = view_.model.rig();
      frame.features.push_back({l.id, rig.camera.project(rig.cam_T_imu * pose.inverse() * x) + noise});
    }
    return frame;
  }

 private:
  Eigen::VectorXd normal(Eigen::Index size) {
    std::normal_distribution<double> draw;
    return Eigen::VectorXd::NullaryExpr(size, [&] { return draw(random_.engine()); });
  }

  const View& view_;
  Random random_;
  Eigen::MatrixXd root_;
};

TEST(FrameUpdate, ReportsAnNisOfMeanOneForWhatFollowsTheModel) {
  for (const bool consensus : {true, false}) {
    FrameUpdate::Options options;
    options.consensus = consensus;
    double nis = 0.0, capped = 0.0, dof = 0.0, used = 0.0;
    for (unsigned run = 0; run < 200; ++run) {
      View view(0.3, run, 12);
      const StereoFrame frame = Truths(view, 1000 + run).frame();
      const FrameOutcome outcome = view.apply(options, frame);
      nis += outcome.nis;
      capped += outcome.capped_nis;
      dof += static_cast<double>(outcome.nis_dof);
      used += static_cast<double>(usedOf(outcome));
    }
    EXPECT_GT(dof, 7000.0);
    EXPECT_GT(used, 0.9 * dof / 3.0);
    EXPECT_NEAR(nis / dof, 1.0, 0.06) << consensus; // the landmarks of a frame share the pose's error
    EXPECT_NEAR(capped / 7200.0, 1.0, 0.06) << consensus;
  }
}

TEST(FrameUpdate, ReportsAnNisOfMeanOneForTracksThatWalkAsTheyState) {
  constexpr double kWalk = 3.0; // px/s^0.5
  const auto nisOf = [&](bool is_stated) {
    FrameUpdate::Options options;
    options.consensus = false;
    options.gate = options.plausible_gate = options.frame_gate = options.motion_gate = 1e9;
    double nis = 0.0;
    for (unsigned run = 0; run < 200; ++run) {
      View view(0.3, run, 12);
      StereoFrame frame = Truths(view, 1000 + run).frame(kWalk);
      std::vector<Association> seen;
      for (std::size_t i = 0; i < frame.features.size(); ++i) {
        frame.features[i].walk = is_stated ? kWalk : 0.0;
        seen.push_back({i, i});
      }
      letTracksWalk(view.filter, view.map, view.model, frame, seen, 0.1);
      nis += view.apply(options, frame).nis / 7200.0;
    }
    return nis;
  };
  EXPECT_NEAR(nisOf(true), 1.0, 0.06);
  EXPECT_GT(nisOf(false), 1.3);
}

TEST(FrameUpdate, LeavesImplausibleObservationsOutOfTheNisAndCountsThemAsJustPlausibleInTheOther) {
  const FrameUpdate::Options options;
  View clean(0.3, 1, 12), view = clean;
  StereoFrame frame = Truths(clean, 2).frame();
  const FrameOutcome all = clean.apply(options, frame);
  EXPECT_EQ(all.nis_dof, 36u);
  EXPECT_DOUBLE_EQ(all.capped_nis, all.nis);
  frame.features[3].pixels += StereoPixels(40.0, 30.0, 40.0, 30.0);
  frame.features[7].pixels += StereoPixels(0.0, 0.0, 25.0, 0.0);
  const FrameOutcome some = view.apply(options, frame);
  EXPECT_EQ(some.nis_dof, 30u);
  EXPECT_LT(some.nis, all.nis);
  EXPECT_FALSE(some.used[3] || some.used[7]);
  EXPECT_NEAR(some.capped_nis, some.nis + 2.0 * options.plausible_gate, 1e-9);
}

TEST(FrameUpdate, LeavesASkippedFrameOutOfTheNis) { // the monitor counts it as refused
  View view(0.3, 1, 12);
  const StereoFrame frame = view.frameOf([&](FeatureId id, const Eigen::Vector3d& q) -> StereoPixels {
    const double u = 30.0 + 10.0 * static_cast<double>(id);
    return view.model.rig().camera.project(q) + (id % 2 ? u : -u) * StereoPixels(1.0, 0.5, 1.0, 0.5);
  });
  const FrameOutcome outcome = view.apply({}, frame);
  EXPECT_TRUE(outcome.skipped);
  EXPECT_EQ(outcome.nis_dof, 0u);
  EXPECT_EQ(outcome.capped_nis, 0.0);
}

} // namespace
} // namespace vi_ekf_slam
