#include "vi_ekf_slam/core/slam/noise_report.hpp"

#include <gtest/gtest.h>

#include "system_drive.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam {
namespace {

const GyroSample kGyroSample{1, Eigen::Vector3d::Zero(), {}};
const VelocitySample kVelocitySample{1, Eigen::Vector3d::Zero(), {}};

template <typename Sample>
Sample with(Sample sample, double x, double y, double z) {
  sample.covariance = Eigen::Vector3d(x, y, z).asDiagonal();
  return sample;
}

TEST(NoiseReport, NamesTheKeyOfAStreamThatGivesNoCovariance) {
  NoiseReport report{Config()};
  EXPECT_EQ(toText(*report.note(kGyroSample)),
            "gyro 0.01 rad/s (invariant/gyro_sigma: its messages give no covariance)");
  EXPECT_EQ(toText(*report.note(kVelocitySample)),
            "velocity 0.1 m/s (invariant/velocity_sigma: its messages give no covariance)");
  EXPECT_EQ(toText(*report.note(StereoFrame{})), "pixels 1 px (invariant/pixel_sigma)");
}

TEST(NoiseReport, TakesWhatTheFirstMessageGivesAndSaysItOnce) {
  NoiseReport report{Config()};
  EXPECT_EQ(toText(*report.note(with(kGyroSample, 0.01, 0.04, 0.25))),
            "gyro 0.316228 rad/s (from its messages)"); // root mean square of the axes
  EXPECT_FALSE(report.note(with(kGyroSample, 1.0, 1.0, 1.0)));
  ASSERT_EQ(report.streams().size(), 1U);
  EXPECT_EQ(report.streams()[0].stream, "gyro");
  EXPECT_NEAR(report.streams()[0].sigma, std::sqrt(0.1), 1e-15);
}

TEST(NoiseReport, SaysWhenTheSourceChanges) {
  NoiseReport report{Config()};
  EXPECT_TRUE(report.note(kVelocitySample));
  EXPECT_TRUE(report.note(with(kVelocitySample, 4.0, 4.0, 4.0)));
  EXPECT_FALSE(report.note(kVelocitySample));
  ASSERT_EQ(report.streams().size(), 1U);
  EXPECT_EQ(report.streams()[0].sigma, 0.1);
  EXPECT_EQ(report.streams()[0].source,
            "invariant/velocity_sigma: its messages give no covariance; later velocity 2 m/s (from its "
            "messages)");
}

TEST(NoiseReport, ThePapersFilterTakesNoCovarianceOfMessages) {
  Config config;
  config.estimator = EstimatorType::kPaper;
  config.paper.pixel_noise = 4.0;
  NoiseReport report(config);
  EXPECT_EQ(toText(*report.note(with(kGyroSample, 9.0, 9.0, 9.0))), "gyro 0.1 rad/s (paper/motion_noise)");
  EXPECT_EQ(toText(*report.note(StereoFrame{})), "pixels 2 px (paper/pixel_noise)");
}

TEST(NoiseReport, OfASystemNamesStreamsAsTheyAreUsed) {
  Config config;
  config.rig_wait_s = 0.0;
  SlamSystem system(config);
  std::vector<std::string> said;
  system.onNoise([&said](const StreamNoise& noise) { said.push_back(noise.stream); });
  const auto measure = [&system](Stamp second) {
    const Stamp stamp = second * 1000000000;
    system.add(GyroSample{stamp, Eigen::Vector3d::Zero(), {}});
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
  EXPECT_EQ(system.noise().streams().size(), 2U);
}

} // namespace
} // namespace vi_ekf_slam
