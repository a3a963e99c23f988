#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/health/blindness.hpp"
#include "vi_ekf_slam/core/motion/dead_reckoning.hpp"
#include "vi_ekf_slam/core/sensors/arrivals.hpp"
#include "vi_ekf_slam/core/sensors/imu_check.hpp"
#include "vi_ekf_slam/core/sensors/lever_arm.hpp"
#include "vi_ekf_slam/core/slam/config.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"
#include "vi_ekf_slam/core/slam/motion_check.hpp"
#include "vi_ekf_slam/core/slam/motion_selection.hpp"
#include "vi_ekf_slam/core/slam/noise_report.hpp"

namespace vi_ekf_slam {

/// The result of one processed measurement.
struct Output {
  StateEstimate state;
  SE3 odom_T_imu;                   ///< dead reckoning: smooth, drifts without bound (REP 105's odom)
  FrameReport report;               ///< only for frames
  double update_s = 0.0;            ///< s of wall time that the estimator took; only for frames
  std::optional<ClosedLoop> loop{}; ///< that the frame has closed
  /// With which the frame came: an offset of the camera's clock has moved that of `state`. Only for frames.
  Stamp frame_stamp = 0;
};

/// Of what was processed.
struct ProcessingCounts {
  std::array<std::uint64_t, kStreamCount> processed{};
  std::uint64_t frames_without_rig = 0;
  std::uint64_t frames_before_start = 0; ///< of an estimator that has no pose at first
  std::uint64_t resets = 0;
  std::uint64_t gaps = 0; ///< longer than max_jump_s, short enough to go on
  std::uint64_t features = 0, features_invalid = 0, features_used = 0, features_rejected = 0;
  std::uint64_t velocities_contradicting = 0; ///< the state, so that they counted less
  std::uint64_t frames_rejected = 0;
  std::uint64_t landmarks_revisited = 0;
  std::uint64_t places_recognised = 0;
  std::uint64_t relocalisations = 0;                         ///< in a loaded map
  std::array<std::uint64_t, kDivergenceCount> divergences{}; ///< recovered from, by Divergence
  double blind_s = 0.0; ///< s of sensor time in periods without a correction by features, see Blindness
  std::uint64_t blind_periods = 0; ///< their number
};

/// Counts since construction; a reset does not clear them.
struct SystemCounts : ArrivalCounts, ProcessingCounts {};

/// What is looked at beside the estimate. Nothing is dropped for it.
struct SensorChecks {
  NoiseReport noise;  ///< that the sensors are taken to have, and from where
  ImuCheck imu;       ///< whether the IMU's samples are what they must be
  MotionCheck motion; ///< whether gyro and velocity move as the pictures do
};

/// The estimator that `config.estimator` asks for.
std::unique_ptr<Estimator> makeEstimator(const Config& config);

/// The one way through the estimator, for node, nodelet, offline runner and tests alike:
/// add -> Arrivals -> Estimator -> handlers. Single-threaded: calls and handlers run
/// in the caller's thread.
class SlamSystem {
 public:
  explicit SlamSystem(const Config& config);
  SlamSystem(const SlamSystem&) = delete; // what decides on the motion calls it
  SlamSystem& operator=(const SlamSystem&) = delete;

  /// Called after each stereo frame, in the order of stamps.
  void onFrame(std::function<void(const Output&)> handler) { handlers_.frame = std::move(handler); }
  /// Called after each gyro sample (the rate of smooth odometry).
  void onImu(std::function<void(const Output&)> handler) { handlers_.gyro = std::move(handler); }
  /// Called after a reset, with the reason and the path that ended, as it was known last.
  using ResetHandler = std::function<void(const std::string& reason, const PathEstimate& path)>;
  void onReset(ResetHandler handler) { handlers_.reset = std::move(handler); }
  /// Called before that with the map that ends, see Estimator::savedMap.
  void onMapEnd(std::function<void(std::function<SavedMap()>)> handler) {
    handlers_.map_end = std::move(handler);
  }
  /// Called when a sensor is used for the first time: which noise it is taken to have, and from where.
  void onNoise(std::function<void(const StreamNoise&)> handler) { handlers_.noise = std::move(handler); }

  /// Calibration. Measurements wait for it at the start, at most `rig_wait_s` of sensor time and as many as
  /// the buffer may hold, unless the configuration does not look at features at all.
  void setRig(const StereoRig& rig);
  bool hasRig() const { return given_.rig.has_value(); }
  /// Whether the configured estimator looks at features, for which it needs the calibration.
  bool needsRig() const;

  /// What is known of the sensors' biases, in place of the configured prior; also after a reset. Throws
  /// std::invalid_argument unless all is finite and the sigmas are positive.
  void setBiasPrior(const TwistBias& bias);
  /// Somebody is going to tell it: the first measurements wait for it, for a second of sensor time beside
  /// `max_delay`. What is computed does not depend on which of the two comes first, then.
  void awaitBiasPrior() { given_.bias_awaited = !given_.bias; }

  /// Before the first measurement: goes on from there, with the inertial motion model. Throws ConfigError for
  /// a configuration that has another one.
  void begin(const InitialState& state);

  /// How the body is taken to move; kAuto as long as no measurement has decided.
  MotionChoice motion() const { return motion_.choice(); }
  /// Why, see MotionSelection::text.
  const std::string& motionText() const { return motion_.text(); }
  /// Called when that is known, with each reason for which there is no pose yet, and when there is one. Of
  /// reasons that differ by their numbers the first is told.
  void onStart(std::function<void(const std::string&)> handler) { handlers_.start = std::move(handler); }

  /// Called with what is wrong with the sensors, once each.
  void onProblem(std::function<void(const std::string&)> handler) {
    checks_.imu.onProblem(handler);
    handlers_.problem = std::move(handler);
  }
  const SensorChecks& checks() const { return checks_; }
  /// The latest stamp that has come since the start; nothing: none has.
  std::optional<Stamp> newest() const { return arrivals_.newest(); }

  /// Processes whatever is due with it. A measurement that is not usable is dropped and counted.
  void add(Measurement measurement);

  /// Processes all that is still held: the data are over.
  void flush();

  /// From now on, also after a reset.
  void setGates(const Gates& gates);

  /// Forgets state and map, keeps calibration, counts and what was loaded.
  void reset(const std::string& reason);
  /// From now on the map of before a reset takes the place of one that was loaded, unless that is still
  /// looked for, or no measurement made the estimate right.
  void keepMap() { keeps_map_ = true; }

  /// The IMU is where somebody says it is, see Estimator::setPose.
  bool setPose(const SE3& world_T_imu, const Matrix6d& covariance) {
    return estimator_->setPose(world_T_imu, covariance);
  }

  /// Begins anew, to find its place in `map`, and does so after every reset. Throws MapError for an estimator
  /// that keeps no joint map.
  void loadMap(std::shared_ptr<const SavedMap> map, const std::string& source);
  /// Before the first measurement: goes on from `map` (see Estimator::resumeFrom); after a reset its place is
  /// looked for. Throws MapError as above, and for a map of another motion model.
  void resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source);

  const Estimator& estimator() const { return *estimator_; }
  SystemCounts counts() const { return {arrivals_.counts(), counts_}; }
  const Blindness& blindness() const { return blindness_; }
  const Config& config() const { return config_; }

 private:
  struct Handlers {
    std::function<void(const Output&)> frame, gyro;
    ResetHandler reset;
    std::function<void(std::function<SavedMap()>)> map_end;
    std::function<void(const std::string&)> start, problem;
    std::function<void(const StreamNoise&)> noise;
  };
  /// What every new estimator is told.
  struct Given {
    std::optional<StereoRig> rig;
    std::optional<TwistBias> bias;
    bool bias_awaited = false;
    std::shared_ptr<const SavedMap> map;
    bool resumes = false; ///< from it
  };

  void requireJointMap(const std::string& source) const;
  void followJump();
  void bridge(Stamp now);
  void seeAgain(const StereoFrame& frame);
  void beginAfterGap(const std::string& reason);
  std::shared_ptr<const SavedMap> mapOfBefore() const;
  void drain();
  void adoptMotion();
  std::unique_ptr<Estimator> makeEstimator() const;
  bool waits() const;
  void reportStart();
  void tellProblem(const std::string& problem) const;
  void updateDeadReckoning(const Measurement& measurement, const StateEstimate& state);
  void process(const Measurement& measurement);
  void process(const ImuSample& sample);
  void process(const VelocitySample& sample);
  void process(const StereoFrame& frame);
  void endInput();
  void beginAnew(const std::string& reason);
  void count(const FrameReport& report);

  Config config_;
  MotionSelection motion_;
  Arrivals arrivals_;
  std::unique_ptr<Estimator> estimator_;
  Given given_;
  bool keeps_map_ = false;
  std::shared_ptr<const SavedMap> before_gap_; ///< in which the place is looked for until it is found
  std::optional<Stamp> reached_;               ///< by the estimate
  std::optional<Stamp> seen_;                  ///< of the last frame that had features
  DeadReckoning dead_reckoning_;
  std::optional<Stamp> last_velocity_; ///< since the start
  LeverArm lever_arm_;
  SensorChecks checks_;
  std::set<std::string> told_starts_; ///< without their numbers
  Blindness blindness_;
  ProcessingCounts counts_;
  Handlers handlers_;
};

} // namespace vi_ekf_slam
