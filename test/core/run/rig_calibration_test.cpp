#include <gtest/gtest.h>

#include <fstream>

#include "../street.hpp"
#include "config_errors.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/run/calibration_files.hpp"

namespace vi_ekf_slam::test {
namespace {

RigEstimate estimate() {
  RigEstimate e{exampleRig(), -0.0125};
  e.rig.cam_T_imu = SE3(so3::Exp({0.1, -2.0, 0.7}), {0.01, -0.2, 3.0});
  e.rotation_sigma << 1e-3, 2e-3, 3e-3;
  e.translation_sigma << 0.01, 0.02, 0.03;
  e.time_offset_sigma = 4e-4;
  e.baseline_sigma = 0.002;
  e.recording << 1700000000.25, 1700000100.5;
  return e;
}

std::string written(const std::string& text) {
  const std::string path = testing::TempDir() + "vi_ekf_slam_rig.yaml";
  std::ofstream(path) << text;
  return path;
}

TEST(RigCalibration, ComesBackAsItWasWritten) {
  const RigEstimate e = estimate(), back = readRigCalibration(written(rigCalibrationText(e)));
  EXPECT_LT(distance(back.rig.cam_T_imu.rotation(), e.rig.cam_T_imu.rotation()), 1e-9);
  EXPECT_LT(distance(back.rig.cam_T_imu.translation(), e.rig.cam_T_imu.translation()), 1e-9);
  EXPECT_NEAR(back.rig.camera.baseline, e.rig.camera.baseline, 1e-9);
  EXPECT_NEAR(back.time_offset, e.time_offset, 1e-12);
  EXPECT_LT(distance(back.rotation_sigma, e.rotation_sigma), 1e-12);
  EXPECT_LT(distance(back.translation_sigma, e.translation_sigma), 1e-12);
  EXPECT_NEAR(back.time_offset_sigma, e.time_offset_sigma, 1e-12);
  EXPECT_NEAR(back.baseline_sigma, e.baseline_sigma, 1e-12);
  EXPECT_LT(distance(back.recording, e.recording), 0.01);
}

// What has no sigma in the configuration is as the file has it, and known.
TEST(RigCalibration, IsWhereTheNextRunGoesOn) {
  const RigEstimate e = estimate();
  const std::string file = written(rigCalibrationText(e));
  const Config config =
      configOf("calibration: {file: " + file + ", rotation_sigma: 0.1, scale_sigma: 0.1}", "test");
  const RigVariables::Options& rig = config.invariant.rig;
  EXPECT_LT(distance(rig.rotation_sigma, e.rotation_sigma), 1e-12);
  EXPECT_TRUE(rig.translation_sigma.isZero(0.0));
  EXPECT_EQ(rig.time_offset_sigma, 0.0);
  EXPECT_NEAR(rig.time_offset, e.time_offset, 1e-12);
  EXPECT_NEAR(rig.scale_sigma * e.rig.camera.baseline, e.baseline_sigma, 1e-9);
  StereoRig told = exampleRig();
  told.camera.baseline = 1.0;
  EXPECT_LT(distance(rig.known->recording, e.recording), 0.01);
  const StereoRig used = rig.appliedTo(told);
  EXPECT_NEAR(used.camera.baseline, e.rig.camera.baseline, 1e-9);
  EXPECT_EQ(used.camera.fu, told.camera.fu);
  EXPECT_LT(distance(used.cam_T_imu.translation(), e.rig.cam_T_imu.translation()), 1e-9);
}

TEST(RigCalibration, NamesWhatIsWrongWithAFile) {
  const std::string good = rigCalibrationText(estimate());
  const auto problem = [](const std::string& text) {
    try {
      readRigCalibration(written(text));
    } catch (const ConfigError& e) {
      return std::string(e.what());
    }
    return std::string("none");
  };
  EXPECT_EQ(problem(good), "none");
  const auto without = [&good](const std::string& key) {
    const std::size_t from = good.find("\n" + key + ":");
    return good.substr(0, from) + good.substr(good.find('\n', from + 1));
  };
  for (const char* key : {"position", "orientation", "baseline", "time_offset", "rotation_sigma",
                          "translation_sigma", "time_offset_sigma", "baseline_sigma"})
    EXPECT_NE(problem(without(key)).find(key), std::string::npos) << problem(without(key));
  EXPECT_EQ(problem(without("recording")), "none") << "of an earlier version";
  EXPECT_NE(problem(good + "more: 1\n").find("more"), std::string::npos);
  EXPECT_NE(problem("orientation: [1, 1, 0, 0]\n" + without("orientation")).find("norm"), std::string::npos);
  EXPECT_NE(problem("baseline: -0.1\n" + without("baseline")).find("baseline"), std::string::npos);
}

} // namespace
} // namespace vi_ekf_slam::test
