#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/health/frame_report.hpp"
#include "vi_ekf_slam/core/map/map_estimate.hpp"
#include "vi_ekf_slam/core/map/saved_map.hpp"
#include "vi_ekf_slam/core/motion/initial_state.hpp"
#include "vi_ekf_slam/core/observation/rig_variables.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// Where the IMU is, how it moves, and how well that is known. The world frame is the IMU frame at the start.
struct StateEstimate {
  Stamp stamp = 0;
  SE3 world_T_imu;
  /// 6x6 of (position error in m, rotation error in rad), both along the WORLD axes: p = p^ + dp,
  /// R = Exp(dtheta) R^. This is the convention of geometry_msgs/PoseWithCovariance.
  Matrix6d pose_covariance = Matrix6d::Zero();
  /// (v in m/s, omega in rad/s), both in the IMU frame.
  Vector6d twist = Vector6d::Zero();
  /// 6x6, same order and frame as `twist`.
  Matrix6d twist_covariance = Matrix6d::Zero();
};

/// The state at a stamp to come; nothing where the orientation is not known to a radian by then.
using Forecast = std::function<std::optional<StateEstimate>(Stamp)>;

struct Gates;

/// A causal estimator of pose and map. Measurements come in the order of their stamps (see
/// MeasurementBuffer); equal stamps are allowed. The first measurement starts the clock at startPose().
class Estimator {
 public:
  virtual ~Estimator() = default;

  /// Calibration of the stereo pair; before it is known frames only advance the clock: features are invalid.
  virtual void setRig(const StereoRig& rig) = 0;

  /// What is known of the biases beforehand, instead of the configured prior.
  virtual void setBiasPrior(const TwistBias& /*bias*/) {}

  /// Before the first measurement: goes on from there. False for an estimator that cannot.
  virtual bool begin(const InitialState& /*state*/) { return false; }
  /// world_T_imu at the first measurement, unless it goes on from elsewhere; nothing where the world's z axis
  /// points up, and only a start can tell.
  virtual std::optional<SE3> startPose() const { return SE3(); }
  /// Whether there is a pose. An estimator that looks for gravity has none at first.
  virtual bool hasStarted() const { return true; }
  /// Why there is none yet, in words; empty: there is one.
  virtual std::string startProblem() const { return {}; }
  /// Why no measurement makes it right any more, in words, so that it is to be begun anew; empty: none is
  /// known.
  virtual std::string contradiction() const { return {}; }

  /// The IMU's sample that follows what is processed next, where it is known already.
  virtual void expect(const ImuSample& /*next*/) {}
  virtual void process(const ImuSample& sample) = 0;
  virtual void process(const VelocitySample& sample) = 0;
  virtual FrameReport process(const StereoFrame& frame) = 0;

  /// From now on; an estimator without such gates has nothing to change.
  virtual void setGates(const Gates& /*gates*/) {}

  /// From now on the IMU is where somebody says it is, known to `covariance` (as in StateEstimate, positive
  /// definite), and landmarks stay where they are. While the place in a loaded map is looked for the pose is
  /// one in that map, and the place is found. False, and nothing changes, for an estimator that cannot.
  virtual bool setPose(const SE3& /*world_T_imu*/, const Matrix6d& /*covariance*/) { return false; }

  /// Whether the estimate may go on after a gap of so many s: the orientation is known well enough then.
  virtual bool canBridge(double /*gap_s*/) const { return true; }
  /// Where the body will be, if nothing is measured until then. Empty for an estimator that cannot tell.
  virtual Forecast forecast() const { return {}; }
  /// Before the first measurement: begins where `forecast` has the body then, in the frame of that.
  virtual void beginAt(Forecast /*forecast*/) {}

  /// The state at the stamp of the last measurement.
  virtual StateEstimate state() const = 0;

  /// The calibration as it is known by now; nothing without a rig, or for an estimator that takes it as it
  /// is.
  virtual std::optional<RigEstimate> rig() const { return std::nullopt; }
  /// By how many s the stamps of frames are to be moved on from the camera's clock to the IMU's.
  virtual double timeOffset() const { return 0.0; }

  /// Every landmark the estimator holds, ordered by id. A covariance may have become smaller since.
  virtual std::vector<LandmarkEstimate> landmarks() const = 0;
  /// The same with the covariances of now. Cheap to be made; calling it computes, which may take as long as
  /// some seconds of the drive did, and may be done in any thread.
  virtual std::function<MapEstimate()> exactMap() const {
    return [all = landmarks()] { return MapEstimate{all, {}}; };
  }

  /// The path so far as it is known now, see PathEstimate; covariances as landmarks(). Without nodes for an
  /// estimator that keeps no joint map: nothing that it learns changes what was.
  virtual PathEstimate path() const { return {}; }
  /// The loop that the last frame has closed.
  virtual std::optional<ClosedLoop> closedLoop() const { return std::nullopt; }

  /// Whether it keeps a joint covariance of pose and map; only then the following do anything.
  virtual bool keepsJointMap() const { return false; }
  /// The state of now with its map. Cheap to be made; calling it computes, as long as exactMap's does, and
  /// may be done in any thread. Empty where there is nothing yet.
  virtual std::function<SavedMap()> savedMap() const { return {}; }
  /// Before the first measurement. Looks for its place in `map`, by ids that return, and takes it over.
  virtual void relocaliseIn(std::shared_ptr<const SavedMap> /*map*/) {}
  /// Before the first measurement. Goes on from `map`, if that was saved at most `max_gap_s` before the first
  /// measurement; else as relocaliseIn. Throws MapError, in the name of `source`, for a map of another motion
  /// model, in which a place can be found all the same.
  virtual void resumeFrom(std::shared_ptr<const SavedMap> /*map*/, const std::string& /*source*/,
                          double /*max_gap_s*/) {}
  virtual MapUse mapUse() const { return MapUse::kNone; }
};

} // namespace vi_ekf_slam
