#include "vi_ekf_slam/simulation/drive_options.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <stdexcept>
#include <string>

namespace vi_ekf_slam::simulation {
namespace {

std::string messageOf(const std::function<void()>& action) {
  try {
    action();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(DriveOptions, EveryOptionReadsBackWhatItWrites) {
  for (const DriveOptionField& field : driveOptionFields()) {
    DriveOptions options;
    const std::string text = driveOptionText(options, field);
    ASSERT_NO_THROW(setDriveOption(options, field.name, text)) << field.name;
    EXPECT_EQ(driveOptionText(options, field), text) << field.name;
  }
}

TEST(DriveOptions, SettingAnOptionChangesItsMember) {
  DriveOptions options;
  setDriveOption(options, "seed", "18446744073709551615");
  setDriveOption(options, "speed", "7.5");
  setDriveOption(options, "features-max", "90");
  setDriveOption(options, "ids-return", "true");
  setDriveOption(options, "motion", "process");
  EXPECT_EQ(options.seed, 18446744073709551615ull);
  EXPECT_EQ(options.speed, 7.5);
  EXPECT_EQ(options.features_max, 90);
  EXPECT_TRUE(options.ids_return);
  EXPECT_EQ(options.motion, MotionModel::kProcessModel);
}

TEST(DriveOptions, ABadValueIsNamedWithItsRange) {
  DriveOptions options;
  EXPECT_EQ(messageOf([&] { setDriveOption(options, "speed", "-1"); }),
            "option 'speed' is '-1', allowed: from 0.5 to 40 m/s");
  EXPECT_EQ(messageOf([&] { setDriveOption(options, "features-max", "2.5"); }),
            "option 'features-max' is '2.5', allowed: a whole number from 1 to 2000");
  for (const char* text : {"", "fast", "9x", "nan", "inf"}) {
    EXPECT_NE(messageOf([&] { setDriveOption(options, "speed", text); }), "") << text;
  }
  for (const char* text : {"-1", "1.0", "18446744073709551616"}) {
    EXPECT_NE(messageOf([&] { setDriveOption(options, "seed", text); }), "") << text;
  }
  EXPECT_NE(messageOf([&] { setDriveOption(options, "ids-return", "maybe"); }), "");
  EXPECT_EQ(messageOf([&] { setDriveOption(options, "sped", "1"); }), "there is no option 'sped'");
}

TEST(DriveOptions, ContradictionsAreNamed) {
  EXPECT_EQ(messageOf([] { checkDriveOptions({}); }), "");
  DriveOptions of_any_rates;
  of_any_rates.frame_rate = 30.0;
  of_any_rates.imu_rate = 400.0;
  EXPECT_EQ(messageOf([&] { checkDriveOptions(of_any_rates); }), "");
  const auto check = [](const std::function<void(DriveOptions&)>& change) {
    return messageOf([&change] {
      DriveOptions options;
      change(options);
      checkDriveOptions(options);
    });
  };
  EXPECT_NE(check([](auto& o) { o.imu_rate = 0.25; }).find("'imu-rate' is '0.25'"), std::string::npos);
  EXPECT_NE(check([](auto& o) { o.gyro_bias_min = 0.5; }).find("'gyro-bias-min'"), std::string::npos);
  EXPECT_NE(check([](auto& o) { o.features_min = 200; }).find("'features-min'"), std::string::npos);
  EXPECT_NE(check([](auto& o) { o.min_depth = 60.0, o.max_depth = 50.0; }).find("'min-depth'"),
            std::string::npos);
  EXPECT_NE(check([](auto& o) { o.motion = MotionModel::kProcessModel; }).find("'duration'"),
            std::string::npos);
  const auto rare = [&check](double rate, double stale) {
    return check([=](auto& o) { o.frame_rate = rate, o.stale_fraction = stale; });
  };
  EXPECT_NE(rare(1.0, 0.09).find("'stale-fraction' is '0.09', allowed: up to 0.05 at a frame-rate of 1 Hz"),
            std::string::npos);
  EXPECT_EQ(rare(2.0, 0.09) + rare(1.0, 0.05) + rare(0.5, 0.0) + rare(200.0, 0.3), "");
  EXPECT_NE(check([](auto& o) { o.speed = -3.0; }).find("'speed' is '-3'"), std::string::npos);
}

} // namespace
} // namespace vi_ekf_slam::simulation
