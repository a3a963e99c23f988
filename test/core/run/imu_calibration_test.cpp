// Files of an IMU's noise and of an initial state.

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <fstream>

#include "../numeric.hpp"
#include "config_errors.hpp"
#include "vi_ekf_slam/core/run/calibration_files.hpp"

namespace vi_ekf_slam::test {
namespace {

class ImuFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(::testing::TempDir()) /
              (std::string("imu_files_") + ::testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string write(const std::string& text) const {
    const std::string path = (folder_ / "file.yaml").string();
    std::ofstream(path) << text;
    return path;
  }

  std::filesystem::path folder_;
};

const char* const kKalibr = R"(#Accelerometers
accelerometer_noise_density: 1.86e-03   #Noise density (continuous-time)
accelerometer_random_walk:   4.33e-04   #Bias random walk
gyroscope_noise_density:     1.87e-04
gyroscope_random_walk:       2.66e-05
rostopic:                    /imu0      #the IMU ROS topic
update_rate:                 200.0      #Hz
)";

// As kalibr_calibrate_imu_camera writes it.
const char* const kKalibrResult = R"(imu0:
  T_i_b:
  - [1.0, 0.0, 0.0, 0.0]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  accelerometer_noise_density: 0.00186
  accelerometer_random_walk: 0.000433
  gyroscope_noise_density: 0.000187
  gyroscope_random_walk: 2.66e-05
  model: calibrated
  rostopic: /imu0
  time_offset: 0.0
  update_rate: 200.0
)";

const char* const kEuroc = R"(%YAML:1.0
#Default imu sensor yaml file
sensor_type: imu
comment: VI-Sensor IMU (ADIS16448)
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0,
         0.0, 1.0, 0.0, 0.0,
         0.0, 0.0, 1.0, 0.0,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 200
gyroscope_noise_density: 1.87e-04     # [ rad / s / sqrt(Hz) ]
gyroscope_random_walk: 2.66e-05       # [ rad / s^2 / sqrt(Hz) ]
accelerometer_noise_density: 1.86e-3  # [ m / s^2 / sqrt(Hz) ]
accelerometer_random_walk: 4.33e-4    # [ m / s^3 / sqrt(Hz) ]
)";

TEST_F(ImuFiles, KalibrsAndEurocsCalibrationsAreReadAsTheyAre) {
  for (const char* const text : {kKalibr, kKalibrResult, kEuroc}) {
    const ImuNoise noise = readImuCalibration(write(text));
    EXPECT_EQ(noise.gyro_density, 1.87e-4) << text;
    EXPECT_EQ(noise.gyro_walk, 2.66e-5) << text;
    EXPECT_EQ(noise.accelerometer_density, 1.86e-3) << text;
    EXPECT_EQ(noise.accelerometer_walk, 4.33e-4) << text;
  }
}

TEST_F(ImuFiles, ACalibrationsErrorNamesFileKeyValueAndWhatIsAllowed) {
  const auto replaced = [](std::string text, const std::string& line, const std::string& by) {
    const auto at = text.find(line);
    EXPECT_NE(at, std::string::npos);
    return text.replace(at, text.find('\n', at) - at, by);
  };
  const auto error = [this](const std::string& text) {
    const std::string path = write(text);
    const std::string message = errorOf([&] { readImuCalibration(path); });
    EXPECT_EQ(message.rfind(path + ": ", 0), 0u) << message;
    return message;
  };
  for (const std::string key : {"gyroscope_noise_density", "accelerometer_noise_density",
                                "gyroscope_random_walk", "accelerometer_random_walk"}) {
    expectAll(error(replaced(kKalibr, key, "")), {key, "missing", "a number"});
    expectAll(error(replaced(kKalibr, key, key + ": -0.5")), {key, "'-0.5'", "a finite number >"});
    expectAll(error(replaced(kKalibr, key, key + ": 1e7")), {key, "'1e7'", "<= 1e+06"});
    expectAll(error(replaced(kKalibr, key, key + ": .nan")), {key, "nan", "a finite number >"});
    expectAll(error(replaced(kKalibr, key, key + ": noise")), {key, "'noise'", "a finite number >"});
    expectAll(error(replaced(kKalibrResult, key, "comment: none")), {"imu0." + key, "missing"});
  }
  // A bias may stand still, a sensor without noise there is none.
  EXPECT_EQ(readImuCalibration(write(replaced(kKalibr, "gyroscope_random_walk", "gyroscope_random_walk: 0")))
                .gyro_walk,
            0.0);
  expectAll(error(replaced(kKalibr, "gyroscope_noise_density", "gyroscope_noise_density: 0")),
            {"gyroscope_noise_density", "'0'", "> 0"});
  error("imu0: 3");
  error("[");
  error("");
  const std::string nowhere = (folder_ / "nowhere.yaml").string();
  expectAll(errorOf([&] { readImuCalibration(nowhere); }), {nowhere, "cannot be opened"});
}

/// An initial state's file: a value of `key` in the place of its own, none where it is empty.
std::string stateFile(const InitialState& state, const std::string& key = "", const std::string& value = "") {
  std::ostringstream text;
  text.precision(17);
  const auto field = [&](const std::string& name, const auto& numbers) {
    if (name == key) {
      if (!value.empty()) text << name << ": " << value << "\n";
      return;
    }
    text << name << ": [";
    for (Eigen::Index i = 0; i < numbers.size(); ++i) text << (i > 0 ? ", " : "") << numbers(i);
    text << "]\n";
  };
  if (key != "stamp")
    text << "stamp: " << state.stamp / 1000000000 << "." << std::to_string(state.stamp).substr(10) << "\n";
  if (key == "stamp" && !value.empty()) text << "stamp: " << value << "\n";
  field("position", state.world_T_imu.translation());
  field("orientation", Eigen::Quaterniond(state.world_T_imu.rotation()).coeffs());
  field("velocity", state.velocity);
  field("gyro_bias", state.gyro_bias);
  field("accelerometer_bias", state.accelerometer_bias);
  field("covariance", state.covariance);
  if (key == "unknown") text << "unknown: 1\n";
  return text.str();
}

InitialState exampleState() {
  Random random(1);
  InitialState state;
  state.stamp = 1403636580838555648;
  state.world_T_imu = SE3::Exp(random.vector<6>(-2.0, 2.0));
  state.velocity = random.vector<3>(-2.0, 2.0);
  state.gyro_bias = random.vector<3>(-0.1, 0.1);
  state.accelerometer_bias = random.vector<3>(-0.1, 0.1);
  state.covariance = 1e-3 * random.covariance<15>();
  state.covariance = (0.5 * (state.covariance + state.covariance.transpose())).eval();
  return state;
}

TEST_F(ImuFiles, AnInitialStateIsReadAsItWasWritten) {
  const InitialState state = exampleState(), read = readInitialState(write(stateFile(state)));
  EXPECT_EQ(read.stamp, state.stamp);
  EXPECT_LT(distance(read.world_T_imu.matrix(), state.world_T_imu.matrix()), 1e-15);
  EXPECT_EQ(read.velocity, state.velocity);
  EXPECT_EQ(read.gyro_bias, state.gyro_bias);
  EXPECT_EQ(read.accelerometer_bias, state.accelerometer_bias);
  EXPECT_EQ(read.covariance, state.covariance);
}

TEST_F(ImuFiles, AnInitialStatesErrorNamesFileFieldValueAndWhatIsAllowed) {
  const InitialState state = exampleState();
  const auto error = [&](const std::string& key, const std::string& value) {
    const std::string path = write(stateFile(state, key, value));
    const std::string message = errorOf([&] { readInitialState(path); });
    expectAll(message, {path + ": ", key});
    return message;
  };
  for (const std::string key :
       {"position", "orientation", "velocity", "gyro_bias", "accelerometer_bias", "covariance"}) {
    expectAll(error(key, ""), {"missing", "numbers"});
    expectAll(error(key, "[1, 2]"), {"[1, 2]", "a list of"});
    expectAll(error(key, "fast"), {"'fast'", "a finite number"});
  }
  expectAll(error("velocity", "[0, .nan, 0]"), {"velocity[1]", "nan", "a finite number"});
  expectAll(error("position", "[0, 0, 1e300]"), {"position[2]", "1e300", "<="});
  expectAll(error("velocity", "[0, 2e3, 0]"), {"of norm 2e+03", "at most 1e+03 m/s"});
  expectAll(error("orientation", "[0, 0, 0, 2]"), {"of norm 2", "norm 1"});
  expectAll(error("stamp", ""), {"missing", "seconds"});
  expectAll(error("stamp", "-3"), {"'-3'", "seconds"});
  expectAll(error("stamp", "now"), {"'now'", "seconds"});
  expectAll(error("unknown", ""), {"unknown key", "accelerometer_bias"});
  InitialState lopsided = state;
  lopsided.covariance(3, 4) += 1e-3;
  InitialState negative = state;
  negative.covariance(7, 7) = -1e-3;
  for (const InitialState& bad : {lopsided, negative}) {
    const std::string path = write(stateFile(bad));
    expectAll(errorOf([&] { readInitialState(path); }), {path, "covariance", "symmetric positive definite"});
  }
}

} // namespace
} // namespace vi_ekf_slam::test
