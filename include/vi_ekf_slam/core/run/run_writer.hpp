#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/run/run_records.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam {

/// What a run's summary.yaml says beside the results themselves.
struct RunSummary {
  RunSummary() = default;
  explicit RunSummary(const SlamSystem& system); ///< with what it tells

  std::string input;   ///< bag, or topics when live
  std::string config;  ///< file or parameter namespace
  double wall_s = 0.0; ///< s of wall time that the run took
  SystemCounts counts;
  /// Messages (and features) that were turned away before they became measurements, by reason.
  std::map<std::string, std::uint64_t> turned_away;
  std::vector<StreamNoise> noise; ///< of the sensors that were used
  std::string motion;             ///< SlamSystem::motionText
  std::string not_started;        ///< why there is no pose at the end; empty: there is one
  ImuCheck::Counts imu;
  std::optional<RigEstimate> rig; ///< at the end
  std::string body; ///< frame whose poses they are: the IMU's, the left camera's where there is no IMU
};

/// Collects the results of a run and writes them into a folder. Units: s, m, rad; poses are of the IMU.
///
/// - trajectory.tum, dead_reckoning.tum: `stamp tx ty tz qx qy qz qw` of world_T_imu and odom_T_imu, a line
///   for each stereo frame. Input without any stereo frame (dead reckoning only) has one for each gyro
///   sample.
/// - covariance.csv: stamp and the upper triangle, row by row, of the 6x6 pose covariance (StateEstimate's
///   convention): x, y, z in m, then rotations a, b, c in rad about the world axes; `xa` is cov(x, a).
/// - trajectory_smoothed.tum, covariance_smoothed.csv: the same moments as they are known at the end
///   (PathEstimate), after loops were closed; of earlier starts where a reset ended them.
/// - frames.csv: the FrameReport of each frame. landmarks.csv: final map. summary.yaml: counts and times.
/// - calibration.yaml: where some of it was estimated, see rigCalibrationText.
///
/// A file appears under its name only when it is complete. Failures throw std::runtime_error with file and
/// cause.
class RunWriter {
 public:
  static constexpr const char *kTrajectory = "trajectory.tum", *kDeadReckoning = "dead_reckoning.tum",
                              *kCovariance = "covariance.csv", *kSmoothed = "trajectory_smoothed.tum",
                              *kSmoothedCovariance = "covariance_smoothed.csv", *kFrames = "frames.csv",
                              *kLandmarks = "landmarks.csv", *kSummary = "summary.yaml";
  static constexpr std::array<const char*, 8> kFiles = {
      kTrajectory,         kDeadReckoning, kCovariance, kSmoothed,
      kSmoothedCovariance, kFrames,        kLandmarks,  kSummary};
  static constexpr const char* kCalibration = "calibration.yaml"; ///< where it was estimated
  /// What the names of the folders of earlier starts begin with.
  static constexpr const char* kBeforeReset = "before_reset_";

  /// `directory`: where what is collected is kept meanwhile, see RecordSpool.
  explicit RunWriter(const std::string& directory = {}) : spool_(std::make_shared<RecordSpool>(directory)) {}

  /// Throws as RunRecords::add does.
  void addFrame(const Output& output);
  /// Kept only as long as there is no frame.
  void addGyro(const Output& output);
  /// A new start (the clock may have gone back): earlier results go to DIR/before_reset_1, _2, ... from now
  /// on. `path`: what is known of them; nothing: they are as they were estimated at the time.
  void restart(std::optional<PathEstimate> path = std::nullopt);

  bool empty() const { return runs_.back().records.empty(); }
  bool hasFrames() const { return runs_.back().has_frames; }
  std::size_t size() const { return runs_.back().records.size(); }
  /// s of sensor time from the first to the last record.
  double sensorSeconds() const { return runs_.back().records.seconds(); }
  /// Stamps of the first and the last record, s.
  Eigen::Vector2d recording() const { return runs_.back().records.firstAndLast(); }
  /// What calibration/file of a configuration takes: `estimate`, of this recording.
  std::string calibrationText(RigEstimate estimate) const;

  /// Number of poses in each of DIR/before_reset_1, _2, ...
  std::vector<std::size_t> earlierSizes() const;
  /// Which of these the results of now go to with the next restart.
  std::string nextEarlier(const std::string& directory) const { return earlierPath(directory, runs_.size()); }

  /// Creates `directory` and its parents, as the writing functions do.
  static void makeDirectory(const std::string& directory);
  /// Throws unless `directory` is there or can be made, and written to, which a long run wants to know early;
  /// makes none, so that a run without results leaves no folder.
  static void requireDirectory(const std::string& directory);
  void write(const std::string& directory, const RunSummary& summary, const MapEstimate& map) const; ///< all
  void writeTrajectory(const std::string& directory) const;
  void writeSmoothed(const std::string& directory, const PathEstimate& path) const;
  static void writeMap(const std::string& directory, const std::vector<LandmarkEstimate>& landmarks);

 private:
  struct Run {
    RunRecords records;
    bool has_frames = false;
    std::optional<PathEstimate> path = std::nullopt; ///< once it has ended
  };

  static std::string earlierPath(const std::string& directory, std::size_t number);
  static void writeRun(const std::string& directory, const Run& run);
  static void writeSmoothed(const std::string& directory, const RunRecords& records,
                            const PathEstimate& path);
  void writeSummary(const std::string& directory, const RunSummary& summary, std::size_t landmarks) const;

  std::shared_ptr<RecordSpool> spool_;
  std::vector<Run> runs_{{RunRecords(spool_)}};
};

/// "sec.nnnnnnnnn", exact.
std::string stampText(Stamp stamp);

} // namespace vi_ekf_slam
