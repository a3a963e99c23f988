#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/slam/config.hpp"
#include "vi_ekf_slam/simulation/consistency.hpp"
#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/inertial/inertial_study.hpp"

namespace vi_ekf_slam::simulation {

/// What became of one frame, against the truth.
struct FrameErrors {
  double time = 0.0; ///< s since the first frame with an estimate
  PoseNees nees;
  double position = 0.0;       ///< m, distance between estimate and truth, without any alignment
  double smoothed = 0.0;       ///< m, the same as it is known at the end of the drive
  double dead_reckoning = 0.0; ///< m, the same for dead reckoning
  Stamp stamp = 0;
  SE3 estimate, truth;         ///< world_T_imu
  double yaw_sigma = 0.0;      ///< rad, published standard deviation of the global yaw
  double nis = 0.0;
  std::size_t nis_dof = 0;
  std::size_t revisited = 0; ///< landmarks found to be ones that were seen before
};

/// One drive through the estimator.
struct SeedResult {
  std::uint64_t seed = 0;
  std::vector<FrameErrors> frames; ///< those with an estimate: none where it never started
  bool begun_anew = false;         ///< the system has, after a gap or a contradiction: judged up to there
  double yaw_fall = 0.0;           ///< largest relative fall of the global yaw variance before an id returned
  std::size_t frames_rejected = 0; ///< as a whole
  /// Frames in which a place was recognised without ids; of these the ones that left the vehicle farther off
  /// than it was, by more than a metre.
  std::size_t places = 0, wrong_places = 0;
  std::size_t features = 0, features_used = 0;
  /// m, absoluteTrajectoryError, and that of the path as it is known at the end; not numbers without an
  /// estimate.
  double ate = InertialOutcome::kNever, smoothed_ate = InertialOutcome::kNever;
  /// Of its nodes: NEES of the pose, mean and largest; not numbers without any.
  double node_nees = InertialOutcome::kNever, largest_node_nees = InertialOutcome::kNever;
  std::optional<InertialOutcome> inertial; ///< with a raw IMU
};

/// Compares the result's frames, and the path as it is known at the end, with their truth.
void judgePath(const PathEstimate& path, SeedResult& result);

/// Shares of the drive at which the NEES is judged.
constexpr std::array<double, 4> kCheckPoints = {0.25, 0.5, 0.75, 1.0};
/// Frame of a drive of `frames` frames that is the check point.
std::size_t checkPointFrame(double share, std::size_t frames);

/// How a Monte Carlo study moves unless told otherwise. kCarDrive: the simulator's defaults (two laps with
/// wrong matches, other cars and stale frames). kProcessModel: 100 s with white noise alone, a sensor for
/// which the default filter's model is exactly right: its densities and gyro biases, no wrong matches, no
/// other cars, no stale frames. With a raw IMU: 3 s at rest, and 60 s of a room or two laps.
DriveOptions studyOptions(MotionModel motion);

/// Simulates a drive and takes it through a SlamSystem of `config`; with a raw IMU it is told the truth (see
/// toldTheTruth), and the paper's filter is refused by std::invalid_argument. Tracks that a stale frame
/// breaks get a new id there, as dataset_to_bag.py gives them one.
SeedResult runSeed(const Config& config, const DriveOptions& options, const InertialStudy& study = {});

/// runSeed for seeds first, first + 1, ... The result depends neither on `jobs` (threads) nor on timing.
/// `progress` is called with the number of seeds done, from any thread but one at a time. The first exception
/// of a seed comes out.
std::vector<SeedResult> runSeeds(const Config& config, const DriveOptions& options, std::uint64_t first,
                                 std::size_t count, unsigned jobs,
                                 const std::function<void(std::size_t)>& progress = {},
                                 const InertialStudy& study = {});

/// Those that have an estimate.
std::vector<SeedResult> startedOf(std::vector<SeedResult> results);

/// Means over the seeds at one frame.
struct MeanErrors {
  double time = 0.0;                                     ///< s
  PoseNees nees;                                         ///< mean
  double position_rmse = 0.0, dead_reckoning_rmse = 0.0; ///< m
  double nis_per_dof = 0.0;
};

/// By frame, as far as the shortest drive goes, of those that have an estimate at all.
std::vector<MeanErrors> meansByFrame(const std::vector<SeedResult>& results);

/// RMS over the frames of `member` of FrameErrors, m.
double rmse(const SeedResult& result, double FrameErrors::*member);
/// Sum of NIS over sum of its degrees of freedom; not a number when there are none.
double nisPerDof(const SeedResult& result);

} // namespace vi_ekf_slam::simulation
