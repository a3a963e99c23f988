#include "vi_ekf_slam/simulation/drive_options.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace vi_ekf_slam::simulation {
namespace {

using O = DriveOptions;

constexpr double kLeastRate = 0.5; // Hz
constexpr double kMostStale = 0.5; // of the frames; beyond it little is left of what the drive is to show
constexpr std::pair<MotionModel, const char*> kMotions[] = {{MotionModel::kCarDrive, "car"},
                                                            {MotionModel::kProcessModel, "process"},
                                                            {MotionModel::kHandheld, "handheld"},
                                                            {MotionModel::kInertialCar, "inertial-car"}};

std::string number(double value) {
  std::ostringstream out;
  out.precision(16);
  out << value;
  return out.str();
}

std::string allowed(const DriveOptionField& field) {
  if (std::holds_alternative<bool O::*>(field.member)) return "true or false";
  if (std::holds_alternative<MotionModel O::*>(field.member)) return "car, process, handheld or inertial-car";
  if (std::holds_alternative<std::uint64_t O::*>(field.member))
    return "a whole number from 0 to 18446744073709551615";
  const bool whole = std::holds_alternative<int O::*>(field.member);
  return std::string(whole ? "a whole number from " : "from ") + number(field.min) + " to " +
         number(field.max) + (*field.unit ? std::string(" ") + field.unit : "");
}

void require(bool condition, const std::string& name, const std::string& value, const std::string& allowed) {
  if (!condition)
    throw std::invalid_argument("option '" + name + "' is '" + value + "', allowed: " + allowed);
}

void require(bool condition, const DriveOptionField& field, const std::string& value) {
  require(condition, field.name, value, allowed(field));
}

void checkRange(const DriveOptionField& field, double value) {
  require(value >= field.min && value <= field.max, field, number(value));
}

double parseDouble(const DriveOptionField& field, const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  require(!text.empty() && *end == '\0', field, text);
  checkRange(field, value);
  return value;
}

std::uint64_t parseSeed(const DriveOptionField& field, const std::string& text) {
  std::istringstream in(text);
  std::uint64_t value = 0;
  const bool digits = !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
  require(digits && in >> value, field, text);
  return value;
}

} // namespace

const char* nameOf(MotionModel motion) {
  const auto is_it = [motion](const auto& named) { return named.first == motion; };
  return std::find_if(std::begin(kMotions), std::end(kMotions), is_it)->second;
}

const std::vector<DriveOptionField>& driveOptionFields() {
  static const std::vector<DriveOptionField> fields = {
      {"seed", &O::seed, 0, 0, "", "same seed and options, same drive"},
      {"motion", &O::motion, 0, 0, "",
       "car: laps round a block; process: the twist is a random walk; handheld: a body shaken in a room, and "
       "inertial-car: the car, both with accelerations and a raw IMU"},
      {"duration", &O::duration, 0, 1e7, "s", "length of the drive; 0: laps decide"},
      {"laps", &O::laps, 0.01, 1e6, "", "laps of the block when duration is 0"},
      {"block-length", &O::block_length, 40, 2000, "m", "longer side of the lap"},
      {"block-width", &O::block_width, 40, 2000, "m", "shorter side of the lap"},
      {"speed", &O::speed, 0.5, 40, "m/s", "on the straights; at the start of the process model"},
      {"corner-speed", &O::corner_speed, 0.5, 10, "m/s", "in the corners"},
      {"standing-start", &O::standing_start, 0, 1e4, "s", "at rest before the start"},
      {"corner-stop", &O::corner_stop, 0, 1e4, "s", "at rest before the first corner"},
      {"start-time", &O::start_time, 0, 4e9, "s", "first stamp, since the epoch"},
      {"frame-rate", &O::frame_rate, kLeastRate, 200, "Hz", "stereo frames"},
      {"imu-rate", &O::imu_rate, 0, 2000, "Hz",
       "gyro and velocity; 0: the same as frame-rate, 200 of a raw IMU"},
      {"velocity-sigma", &O::velocity_sigma, 0, 10, "m/s", "white noise per sample and axis"},
      {"gyro-sigma", &O::gyro_sigma, 0, 1, "rad/s", "white noise per sample and axis"},
      {"gyro-bias-min", &O::gyro_bias_min, 0, 1, "rad/s", "least magnitude of an axis' constant bias"},
      {"gyro-bias-max", &O::gyro_bias_max, 0, 1, "rad/s", "largest magnitude of an axis' constant bias"},
      {"gyro-bias-sigma", &O::gyro_bias_sigma, 0, 1, "rad/s",
       "above 0: normal biases instead of min and max"},
      {"velocity-bias-sigma", &O::velocity_bias_sigma, 0, 10, "m/s", "constant normal bias per axis"},
      {"pixel-sigma", &O::pixel_sigma, 0, 10, "px", "white noise per coordinate"},
      {"pixel-correlation", &O::pixel_correlation, 0, 1, "", "of the noise in the left and the right image"},
      {"drift-position", &O::drift_position, 0, 1, "m/m^0.5",
       "random walk of the error that all tracks share, per distance driven"},
      {"drift-rotation", &O::drift_rotation, 0, 0.1, "rad/m^0.5", "the same, turning about the vehicle"},
      {"track-walk", &O::track_walk, 0, 100, "px/s^0.5",
       "random walk of each track by itself, alike in both images"},
      {"features-max", &O::features_max, 1, 2000, "", "tracks after the fullest re-detection"},
      {"features-min", &O::features_min, 0, 2000, "", "fewer tracks call for a re-detection"},
      {"track-median", &O::track_median, 0.01, 1e6, "s", "median of the exponential track life"},
      {"track-max", &O::track_max, 0.01, 1e6, "s", "longest track"},
      {"outlier-fraction", &O::outlier_fraction, 0, 1, "",
       "tracks that are wrong matches or drift off their point"},
      {"moving-objects", &O::moving_objects, 0, 50, "", "other cars at a time, 5 to 10 features each"},
      {"stale-fraction", &O::stale_fraction, 0, 0.3, "",
       "frames in 0.1 s that repeat the pixels of the frame before"},
      {"strength-spread", &O::strength_spread, 0, 10, "",
       "sigma of the points' log strength; 3: mostly the same are detected"},
      {"ids-return", &O::ids_return, 0, 1, "", "whether a landmark seen again has its old id"},
      {"corner-sigma", &O::corner_sigma, 0, 1, "m",
       "per axis, from a landmark to the point that a track of it follows"},
      {"descriptors", &O::descriptors, 0, 1, "",
       "whether features come with descriptors of what they look like"},
      {"alike-share", &O::alike_share, 0, 1, "", "landmarks that look like one of twenty kinds"},
      {"alike-streets", &O::alike_streets, 0, 1, "",
       "whether the long streets are the same every 40 m, points and looks"},
      {"min-depth", &O::min_depth, 0.5, 100, "m", "nearest landmark used"},
      {"max-depth", &O::max_depth, 5, 1000, "m", "farthest landmark used"},
      {"twist-decay", &O::twist_decay, 0, 1e6, "s", "process model: time constant back to speed; 0: none"},
      {"noise-forward", &O::noise_forward, 0, 10, "m/s^1.5", "process model: acceleration along x"},
      {"noise-lateral", &O::noise_lateral, 0, 10, "m/s^1.5", "process model: acceleration along y"},
      {"noise-vertical", &O::noise_vertical, 0, 10, "m/s^1.5", "process model: acceleration along z"},
      {"noise-rotation", &O::noise_rotation, 0, 10, "rad/s^1.5", "process model: angular acceleration"},
      {"peak-rate", &O::peak_rate, 0.1, 20, "rad/s", "handheld: largest angular rate"},
      {"peak-acceleration", &O::peak_acceleration, 0.1, 100, "m/s^2", "handheld: largest acceleration"},
      {"gyro-density", &O::gyro_density, 0, 0.1, "rad/s/Hz^0.5", "raw IMU: white noise of the gyro"},
      {"accelerometer-density", &O::accelerometer_density, 0, 1, "m/s^2/Hz^0.5",
       "raw IMU: white noise of the accelerometer"},
      {"gyro-walk", &O::gyro_walk, 0, 0.1, "rad/s^2/Hz^0.5", "raw IMU: random walk of the gyro's bias"},
      {"accelerometer-walk", &O::accelerometer_walk, 0, 1, "m/s^3/Hz^0.5",
       "raw IMU: random walk of the accelerometer's bias"},
      {"accelerometer-bias-sigma", &O::accelerometer_bias_sigma, 0, 5, "m/s^2",
       "raw IMU: first bias of the accelerometer, per axis"},
      {"accelerometer-scale-sigma", &O::accelerometer_scale_sigma, 0, 0.1, "",
       "raw IMU: scale and alignment of the accelerometer's axes, each element"},
      {"frame-offset", &O::frame_offset, 0, 0.99, "",
       "raw IMU: from a sample to the first frame, in its periods"},
      {"velocity-samples", &O::velocity_samples, 0, 1, "", "raw IMU: whether velocities come with it"},
  };
  return fields;
}

void setDriveOption(DriveOptions& options, const std::string& name, const std::string& text) {
  for (const DriveOptionField& field : driveOptionFields()) {
    if (name != field.name) continue;
    if (const auto* d = std::get_if<double O::*>(&field.member)) {
      options.*(*d) = parseDouble(field, text);
    } else if (const auto* i = std::get_if<int O::*>(&field.member)) {
      const double value = parseDouble(field, text);
      require(value == std::floor(value), field, text);
      options.*(*i) = static_cast<int>(value);
    } else if (const auto* s = std::get_if<std::uint64_t O::*>(&field.member)) {
      options.*(*s) = parseSeed(field, text);
    } else if (const auto* b = std::get_if<bool O::*>(&field.member)) {
      require(text == "true" || text == "false", field, text);
      options.*(*b) = text == "true";
    } else {
      const auto is_it = [&text](const auto& named) { return named.second == text; };
      const auto* motion = std::find_if(std::begin(kMotions), std::end(kMotions), is_it);
      require(motion != std::end(kMotions), field, text);
      options.motion = motion->first;
    }
    return;
  }
  throw std::invalid_argument("there is no option '" + name + "'");
}

std::string driveOptionText(const DriveOptions& options, const DriveOptionField& field) {
  if (const auto* d = std::get_if<double O::*>(&field.member)) return number(options.*(*d));
  if (const auto* i = std::get_if<int O::*>(&field.member)) return std::to_string(options.*(*i));
  if (const auto* s = std::get_if<std::uint64_t O::*>(&field.member)) return std::to_string(options.*(*s));
  if (const auto* b = std::get_if<bool O::*>(&field.member)) return options.*(*b) ? "true" : "false";
  return nameOf(options.motion);
}

void checkDriveOptions(const DriveOptions& options) {
  for (const DriveOptionField& field : driveOptionFields()) {
    if (const auto* d = std::get_if<double O::*>(&field.member)) checkRange(field, options.*(*d));
    if (const auto* i = std::get_if<int O::*>(&field.member)) checkRange(field, options.*(*i));
  }
  require(options.imuRate() >= kLeastRate, "imu-rate", number(options.imu_rate),
          "0 or from " + number(kLeastRate) + " Hz");
  require(options.gyro_bias_min <= options.gyro_bias_max, "gyro-bias-min", number(options.gyro_bias_min),
          "up to gyro-bias-max, " + number(options.gyro_bias_max) + " rad/s");
  require(options.features_min <= options.features_max, "features-min", std::to_string(options.features_min),
          "up to features-max, " + std::to_string(options.features_max));
  require(options.min_depth < options.max_depth, "min-depth", number(options.min_depth),
          "below max-depth, " + number(options.max_depth) + " m");
  const double most_stale = kMostStale * O::kStaleSlot * options.frame_rate;
  require(options.stale_fraction <= most_stale, "stale-fraction", number(options.stale_fraction),
          "up to " + number(most_stale) + " at a frame-rate of " + number(options.frame_rate) +
              " Hz, where half of the frames are stale then");
  const bool is_process = options.motion == MotionModel::kProcessModel;
  require(options.duration > 0.0 || !(is_process || options.motion == MotionModel::kHandheld), "duration",
          "0", "above 0 s when motion is " + std::string(nameOf(options.motion)) + ", which has no laps");
  require(!(options.ids_return && is_process), "ids-return", "true",
          "false when motion is process, whose landmarks do not return");
}

} // namespace vi_ekf_slam::simulation
