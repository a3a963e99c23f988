#include "../road.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

SE3 endOf(double slip_sigma, double feature_sigma) {
  InvariantConfig config = steadyTracks();
  config.slip.sigma = slip_sigma;
  InvariantEstimator estimator(config);
  estimator.setRig(exampleRig());
  Road road(1, 30, {0.1, 0.01, 0.5});
  for (int i = 0; i < 50; ++i)
    road.feed(estimator, [&](StereoFrame& frame) {
      for (auto& feature : frame.features) feature.sigma = feature_sigma;
    });
  return estimator.state().world_T_imu;
}

// What a front end says of its tracks is taken at its word; of those of another one it is estimated.
TEST(TrackSlip, IsOfTracksThatDoNotStateTheirSigma) {
  EXPECT_GT(distance(endOf(0.02, 0.0).matrix(), endOf(0.0, 0.0).matrix()), 1e-4);
  EXPECT_LT(distance(endOf(0.02, 1.0).matrix(), endOf(0.0, 1.0).matrix()), 1e-9);
}

} // namespace
} // namespace vi_ekf_slam
