#include "vi_ekf_slam/core/slam/noise_report.hpp"

#include <gtest/gtest.h>

#include "../system_drive.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam {
namespace {

const ImuSample kGyroSample{1, Eigen::Vector3d::Zero(), {}};
const VelocitySample kVelocitySample{1, Eigen::Vector3d::Zero(), {}};

template <typename Sample>
Sample with(Sample sample, double x, double y, double z) {
  sample.covariance = Eigen::Vector3d(x, y, z).asDiagonal();
  return sample;
}

TEST(NoiseReport, NamesTheKeyOfAStreamThatGivesNoCovariance) {
  NoiseReport report{Config()};
  EXPECT_EQ(toText(report.note(kGyroSample).at(0)),
            "gyro 0.01 rad/s (invariant/gyro_sigma: its messages give no covariance)");
  EXPECT_EQ(toText(report.note(kVelocitySample).at(0)),
            "velocity 0.1 m/s (invariant/velocity_sigma: its messages give no covariance)");
  EXPECT_EQ(toText(report.note(StereoFrame{}).at(0)), "pixels 1 px (invariant/pixel_sigma)");
}

TEST(NoiseReport, TakesWhatTheFirstMessageGivesAndSaysItOnce) {
  NoiseReport report{Config()};
  EXPECT_EQ(toText(report.note(with(kGyroSample, 0.01, 0.04, 0.25)).at(0)),
            "gyro 0.316228 rad/s (from its messages)"); // root mean square of the axes
  EXPECT_TRUE(report.note(with(kGyroSample, 1.0, 1.0, 1.0)).empty());
  ASSERT_EQ(report.streams().size(), 1U);
  EXPECT_EQ(report.streams()[0].stream, "gyro");
  EXPECT_NEAR(report.streams()[0].sigma, std::sqrt(0.1), 1e-15);
}

TEST(NoiseReport, SaysWhenTheSourceChanges) {
  NoiseReport report{Config()};
  EXPECT_EQ(report.note(kVelocitySample).size(), 1U);
  EXPECT_EQ(report.note(with(kVelocitySample, 4.0, 4.0, 4.0)).size(), 1U);
  EXPECT_TRUE(report.note(kVelocitySample).empty());
  ASSERT_EQ(report.streams().size(), 1U);
  EXPECT_EQ(report.streams()[0].sigma, 0.1);
  EXPECT_EQ(report.streams()[0].source,
            "invariant/velocity_sigma: its messages give no covariance; later velocity 2 m/s (from its "
            "messages)");
}

ImuSample inertialSample(double t, bool with_covariances) {
  ImuSample sample{fromSeconds(t), Eigen::Vector3d::Zero(), {}, Eigen::Vector3d(0.0, 0.0, 9.81), {}};
  if (!with_covariances) return sample;
  sample.covariance = 4e-6 * Eigen::Matrix3d::Identity();
  sample.acceleration_covariance = 4e-2 * Eigen::Matrix3d::Identity();
  return sample;
}

/// All that it says of two tenths of a second of an IMU at 100 Hz.
std::vector<std::string> saidOf(NoiseReport& report, bool with_covariances) {
  report.setInertial(true);
  std::vector<std::string> said;
  for (int i = 0; i < 20; ++i) {
    for (const auto& noise : report.note(inertialSample(1.0 + 0.01 * i, with_covariances)))
      said.push_back(toText(noise));
  }
  return said;
}

TEST(NoiseReport, OfAnInertialModelGivesDensitiesFromTheMessagesCovariancesAndRate) {
  NoiseReport report{Config()};
  EXPECT_EQ(saidOf(report, true),
            (std::vector<std::string>{
                "gyro 0.0002 rad/s/sqrt(Hz) (from its messages' covariance at 100 Hz)",
                "accelerometer 0.02 m/s^2/sqrt(Hz) (from its messages' covariance at 100 Hz)"}));
  ASSERT_EQ(report.streams().size(), 2U);
  EXPECT_EQ(report.streams()[1].stream, "accelerometer");
}

TEST(NoiseReport, OfAnInertialModelNamesTheKeyWhereTheMessagesSayNothing) {
  Config config;
  config.invariant.inertial.noise.gyro_density = 0.5;
  NoiseReport report{config};
  const std::string source = "(inertial/imu_noise: its messages give no covariance)";
  EXPECT_EQ(saidOf(report, false),
            (std::vector<std::string>{"gyro 0.5 rad/s/sqrt(Hz) " + source,
                                      "accelerometer 0.002 m/s^2/sqrt(Hz) " + source}));
}

TEST(NoiseReport, OfAnInertialModelTakesACalibrationFileBeforeTheMessages) {
  Config config;
  config.invariant.inertial.noise_given = true;
  config.invariant.inertial.noise_file = "imu.yaml";
  NoiseReport report{config};
  EXPECT_EQ(
      saidOf(report, true),
      (std::vector<std::string>{"gyro 0.0002 rad/s/sqrt(Hz) (inertial/imu_calibration: imu.yaml)",
                                "accelerometer 0.002 m/s^2/sqrt(Hz) (inertial/imu_calibration: imu.yaml)"}));
}

TEST(NoiseReport, ThePapersFilterTakesNoCovarianceOfMessages) {
  Config config;
  config.estimator = EstimatorType::kPaper;
  config.paper.pixel_noise = 4.0;
  NoiseReport report(config);
  EXPECT_EQ(toText(report.note(with(kGyroSample, 9.0, 9.0, 9.0)).at(0)),
            "gyro 0.1 rad/s (paper/motion_noise)");
  EXPECT_EQ(toText(report.note(StereoFrame{}).at(0)), "pixels 2 px (paper/pixel_noise)");
}

TEST(NoiseReport, OfASystemNamesStreamsAsTheyAreUsed) {
  Config config;
  config.rig_wait_s = 0.0;
  SlamSystem system(config);
  std::vector<std::string> said;
  system.onNoise([&said](const StreamNoise& noise) { said.push_back(noise.stream); });
  const auto measure = [&system](Stamp second) {
    const Stamp stamp = second * 1000000000;
    system.add(ImuSample{stamp, Eigen::Vector3d::Zero(), {}});
    system.add(StereoFrame{stamp, {}});
    system.flush();
  };
  measure(1);
  EXPECT_EQ(said,
            (std::vector<std::string>{"gyro"})); // features are not used before the calibration is known
  system.setRig(test::exampleRig());
  measure(2);
  system.reset("for no reason");
  measure(3);
  EXPECT_EQ(said, (std::vector<std::string>{"gyro", "pixels"}));
  EXPECT_EQ(system.checks().noise.streams().size(), 2U);
}

} // namespace
} // namespace vi_ekf_slam
