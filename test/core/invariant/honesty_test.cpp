#include <algorithm>
#include <cmath>
#include <vector>

#include "road.hpp"
#include "states.hpp"
#include "vi_ekf_slam/core/invariant/frame_update.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

TEST(InvariantEstimator, TakesTheCovarianceOfTheSample) {
  const InvariantConfig config;
  for (const double sigma : {0.01, 0.5}) {
    const Eigen::Matrix3d R = sigma * sigma * Eigen::Matrix3d::Identity();
    InvariantEstimator estimator(config);
    estimator.process(GyroSample{1, {0.1, 0.2, 0.3}, R});
    estimator.process(VelocitySample{1, {5.0, 0.2, 0.3}, R});
    const StateEstimate state = estimator.state();
    for (int i = 0; i < 6; ++i) {
      const double P = std::pow(config.prior_twist_sigma[i], 2);
      const double grade =
          std::min(1.0, std::pow(sigma / (i < 3 ? config.velocity_sigma : config.gyro_sigma), 2));
      const double B = std::pow(grade * config.prior_bias_sigma[i], 2); // see bias_test.cpp
      EXPECT_NEAR(state.twist_covariance(i, i), P - P * P / (P + B + sigma * sigma), 1e-12);
    }
    EXPECT_NEAR(state.twist[0], 5.0 * 225.0 / (225.0 + sigma * sigma), 1e-6);
  }
  // Without one the configured noise holds.
  InvariantEstimator silent(config), told(config);
  silent.process(GyroSample{1, {0.1, 0.2, 0.3}, {}});
  told.process(GyroSample{1, {0.1, 0.2, 0.3}, Eigen::Matrix3d(0.0025 * Eigen::Matrix3d::Identity())});
  expectSame(silent.state(), told.state(), 1e-15);
}

/// The default filter for a front end whose tracks do not slide.
InvariantConfig withoutDrift() {
  InvariantConfig config;
  config.drift_position = config.drift_rotation = 0.0;
  return config;
}

TEST(InvariantEstimator, KnowsHowWrongItIs) {
  const InvariantConfig config = withoutDrift();
  double nees = 0.0;
  constexpr int kRuns = 40;
  for (unsigned run = 0; run < kRuns; ++run) {
    Road road(100 + run, 25, {config.velocity_sigma, config.gyro_sigma, config.pixel_sigma});
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

/// Draws from the state's own covariance, landmark by landmark where it lies truly and how it is seen.
class Truths {
 public:
  Truths(const State& state, const StereoModel& model, unsigned seed)
      : model_(model), random_(seed), estimate_(meanOf(state)) {
    const Eigen::MatrixXd P = state.covariance();
    root_ = P.llt().matrixL();
  }

  StereoFrame frame() {
    const Mean truth = truthAt(estimate_, root_ * normal(root_.rows()));
    StereoFrame frame;
    for (std::size_t i = 0; i < truth.landmarks.size(); ++i) {
      const Eigen::Vector3d q = model_.rig().cam_T_imu * truth.pose.inverse() * truth.landmarks[i];
      // Of the four coordinates, whose mean of both rows has half the variance.
      const Eigen::VectorXd noise = std::sqrt(model_.noise()(0, 0)) * normal(4);
      frame.features.push_back({i, model_.rig().camera.project(q) + noise});
    }
    return frame;
  }

 private:
  Eigen::VectorXd normal(Eigen::Index size) {
    std::normal_distribution<double> draw;
    return Eigen::VectorXd::NullaryExpr(size, [&] { return draw(random_.engine()); });
  }

  const StereoModel& model_;
  Random random_;
  Mean estimate_;
  Eigen::MatrixXd root_;
};

TEST(FrameUpdate, ReportsAnNisOfMeanOneForWhatFollowsTheModel) {
  for (const bool consensus : {true, false}) {
    InvariantConfig config;
    config.consensus = consensus;
    const StereoModel model(exampleRig(), 0.3, 0.5);
    const FrameUpdate update(config, model);
    double nis = 0.0, dof = 0.0, used = 0.0;
    for (unsigned run = 0; run < 200; ++run) {
      State state = seenState(model, run, 12);
      Truths truths(state, model, 1000 + run);
      const StereoFrame frame = truths.frame();
      const FrameOutcome outcome = update.apply(state, frame, observe(model, state, frame), {});
      nis += outcome.nis;
      dof += static_cast<double>(outcome.nis_dof);
      used += static_cast<double>(std::count(outcome.used.begin(), outcome.used.end(), true));
    }
    EXPECT_GT(dof, 7000.0);
    EXPECT_GT(used, 0.9 * dof / 3.0);
    EXPECT_NEAR(nis / dof, 1.0, 0.06) << consensus; // the landmarks of a frame share the pose's error
  }
}

TEST(FrameUpdate, LeavesImplausibleObservationsOutOfTheNis) {
  const InvariantConfig config;
  const StereoModel model(exampleRig(), 0.3, 0.5);
  State clean = seenState(model, 1, 12), state = clean;
  StereoFrame frame = Truths(clean, model, 2).frame();
  const FrameOutcome all = FrameUpdate(config, model).apply(clean, frame, observe(model, clean, frame), {});
  EXPECT_EQ(all.nis_dof, 36u);
  frame.features[3].pixels += StereoPixels(40.0, 30.0, 40.0, 30.0);
  frame.features[7].pixels += StereoPixels(0.0, 0.0, 25.0, 0.0);
  const FrameOutcome some = FrameUpdate(config, model).apply(state, frame, observe(model, state, frame), {});
  EXPECT_EQ(some.nis_dof, 30u);
  EXPECT_LT(some.nis, all.nis);
  EXPECT_FALSE(some.used[3] || some.used[7]);
}

} // namespace
} // namespace vi_ekf_slam::invariant
