#pragma once

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

namespace vi_ekf_slam::simulation {

enum class MotionModel {
  kCarDrive,     ///< a car round a rectangular block, lap after lap
  kProcessModel, ///< white noise on the twist's derivative: an exact draw from a constant-velocity prior
  kHandheld,     ///< a hand-held or flying body in a room, with a raw IMU
  kInertialCar,  ///< the car with smooth accelerations and a raw IMU
};

/// What to simulate. The defaults resemble the real drives: 10 Hz, a noisy twist, stale frames, other cars.
/// Units, limits and help of every member: driveOptionFields().
struct DriveOptions {
  std::uint64_t seed = 1;
  MotionModel motion = MotionModel::kCarDrive;
  double duration = 0.0; ///< s; 0: `laps` decide
  double laps = 2.0;
  double block_length = 140.0;         ///< m
  double block_width = 90.0;           ///< m
  double speed = 9.0;                  ///< m/s on the straights; of the process model's start
  double corner_speed = 4.5;           ///< m/s
  double standing_start = 0.0;         ///< s at rest before the start
  double corner_stop = 0.0;            ///< s at rest before the first corner
  double start_time = 1317386425.5625; ///< s since the epoch

  double frame_rate = 10.0; ///< Hz
  double imu_rate = 0.0;    ///< Hz, gyro and velocity; 0: the same, 200 of a raw IMU

  double velocity_sigma = 0.5;      ///< m/s, white, per sample and axis
  double gyro_sigma = 0.05;         ///< rad/s, white, per sample and axis
  double gyro_bias_min = 0.004;     ///< rad/s, least magnitude of the constant bias of an axis
  double gyro_bias_max = 0.010;     ///< rad/s, largest; uniform in between, random sign
  double gyro_bias_sigma = 0.0;     ///< rad/s; > 0: normal biases instead of the two above
  double velocity_bias_sigma = 0.0; ///< m/s, constant normal bias per axis

  double pixel_sigma = 0.7;       ///< px per coordinate, white in time
  double pixel_correlation = 0.0; ///< between the left and the right coordinate of one observation
  /// Root spectral densities, per distance driven, of the error that all tracks have in common: m/m^0.5, and
  /// rad/m^0.5 about the vehicle.
  double drift_position = 0.0;
  double drift_rotation = 0.0;
  /// px/s^0.5, root spectral density of each track's own random walk, the same in both images.
  double track_walk = 0.0;
  int features_max = 115;         ///< tracks after the fullest re-detection
  int features_min = 25;          ///< fewer tracks than this call for a re-detection
  double track_median = 2.6;      ///< s; median of the exponential track life, if nothing else ends it
  double track_max = 17.0;        ///< s, the longest track
  double outlier_fraction = 0.03; ///< of the tracks: wrong stereo matches, and drifting tracks
  int moving_objects = 2;         ///< other cars at a time, 5 to 10 features each
  /// Re-detections that repeat the surviving tracks' pixels, in 0.1 s: of the frames at 10 Hz, and as many in
  /// a second at any other rate.
  double stale_fraction = 0.09;
  static constexpr double kStaleSlot = 0.1; ///< s, in which stale_fraction counts
  bool ids_return = false; ///< whether a landmark that is detected again has its old id
  /// Of the points' log strength, by which they are detected: with 0 one is detected as easily as another,
  /// with 3 it is nearly always the same ones.
  double strength_spread = 0.0;
  /// m, per axis, from a landmark to the point that a track of it follows: a detector that finds a corner
  /// again does not find the same point of it.
  double corner_sigma = 0.0;
  bool descriptors = false;   ///< whether features have descriptors
  double alike_share = 0.2;   ///< of the landmarks, that look like one of a few others
  bool alike_streets = false; ///< the same points with the same looks every 40 m
  double min_depth = 3.0;     ///< m
  double max_depth = 150.0;   ///< m

  double twist_decay = 0.0;    ///< s, time constant back to the nominal twist; 0: never, an exact random walk
  double noise_forward = 0.5;  ///< m/s^1.5, root spectral density of the acceleration along x
  double noise_lateral = 0.15; ///< m/s^1.5, along y
  double noise_vertical = 0.15; ///< m/s^1.5, along z
  double noise_rotation = 0.1;  ///< rad/s^1.5, of the angular acceleration, each axis

  double peak_rate = 3.49;         ///< rad/s, handheld: of the angular rate's norm
  double peak_acceleration = 9.81; ///< m/s^2, handheld: of the acceleration's norm

  // A raw IMU, as calibrations state it; gyro_sigma does not count for it.
  double gyro_density = 1.7e-4;           ///< rad/s/Hz^0.5, white noise
  double accelerometer_density = 2e-3;    ///< m/s^2/Hz^0.5, white noise
  double gyro_walk = 2e-5;                ///< rad/s^2/Hz^0.5, random walk of the bias
  double accelerometer_walk = 3e-3;       ///< m/s^3/Hz^0.5, random walk of the bias
  double accelerometer_bias_sigma = 0.05; ///< m/s^2, of the first bias, per axis
  double accelerometer_scale_sigma = 0.0; ///< 1, of its axes' scales and alignment, each element
  double frame_offset = 0.4;              ///< of the IMU's period, from a sample to the first frame
  bool velocity_samples = false;          ///< a velocity with each sample of a raw IMU

  /// Whether the motion has accelerations and the IMU measures them.
  bool hasRawImu() const { return motion == MotionModel::kHandheld || motion == MotionModel::kInertialCar; }
  /// imu_rate with its default resolved, Hz.
  double imuRate() const { return imu_rate > 0.0 ? imu_rate : hasRawImu() ? 200.0 : frame_rate; }
};

/// Describes one member of DriveOptions; one table serves checks, command lines and help texts.
struct DriveOptionField {
  using Member = std::variant<double DriveOptions::*, int DriveOptions::*, bool DriveOptions::*,
                              std::uint64_t DriveOptions::*, MotionModel DriveOptions::*>;
  const char* name;
  Member member;
  double min; ///< of numbers
  double max; ///< of numbers
  const char* unit;
  const char* help;
};

/// How the options name it: car, process, handheld or inertial-car.
const char* nameOf(MotionModel motion);

const std::vector<DriveOptionField>& driveOptionFields();

/// Sets the option `name` from text. Throws std::invalid_argument that names option, value and allowed range.
void setDriveOption(DriveOptions& options, const std::string& name, const std::string& text);

/// The option's value as setDriveOption reads it.
std::string driveOptionText(const DriveOptions& options, const DriveOptionField& field);

/// Throws std::invalid_argument for values out of range or options that contradict each other.
void checkDriveOptions(const DriveOptions& options);

} // namespace vi_ekf_slam::simulation
