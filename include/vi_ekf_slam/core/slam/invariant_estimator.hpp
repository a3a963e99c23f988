#pragma once

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/motion/standstill.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"
#include "vi_ekf_slam/core/slam/invariant_config.hpp"
#include "vi_ekf_slam/core/slam/joint_map.hpp"
#include "vi_ekf_slam/core/tracking/track_status.hpp"

namespace vi_ekf_slam {

/// The right-invariant EKF SLAM: wires the rooms as a measurement passes them (docs/architecture.md).
class InvariantEstimator : public Estimator {
 public:
  explicit InvariantEstimator(const InvariantConfig& config);

  void setRig(const StereoRig& rig) override;
  void setBiasPrior(const TwistBias& bias) override { motion_->setBiasPrior(filter_, bias); }
  bool begin(const InitialState& state) override;
  std::optional<SE3> startPose() const override { return motion_->startPose(); }
  /// What is known of the IMU from before the state that it begins with.
  void preset(const ImuTrack& imu) { imu_ = imu; }
  /// Goes on from a saved map if it may (see resumeFrom), for the first measurement, at `now`; whether it
  /// does.
  bool resumeAt(Stamp now);
  /// Between the two neither rotation nor velocity is known, and points start as SceneDisparities has them.
  void startOpen() { is_starting_ = true; }
  void endStart() {
    is_starting_ = false;
    if (model_) model_->forgetScene(filter_);
  }
  /// From now on the map begins where the body is: at the origin, its heading along x. Before anything is
  /// inactive.
  void moveOriginHere();
  /// The same, but that the body was at `there`, as far as that is known, when it was at `begun` in the map
  /// of now, whose z axis points up.
  void moveOrigin(const SE3& begun, const StateEstimate& there);
  void expect(const ImuSample& next) override { imu_.expect(next); }
  void process(const ImuSample& sample) override;
  void process(const VelocitySample& sample) override;
  FrameReport process(const StereoFrame& frame) override;
  Eigen::Vector3d gyroBias() const { return motion_->gyroBias(filter_); }                   ///< rad/s
  Eigen::Vector3d accelerometerBias() const { return motion_->accelerometerBias(filter_); } ///< m/s^2
  void setGates(const Gates& gates) override { config_.setGates(gates); }
  bool setPose(const SE3& world_T_imu, const Matrix6d& covariance) override;
  bool canBridge(double gap_s) const override;
  Forecast forecast() const override;
  StateEstimate state() const override;
  std::optional<RigEstimate> rig() const override;
  double timeOffset() const override;
  std::vector<LandmarkEstimate> landmarks() const override;
  std::function<MapEstimate()> exactMap() const override;
  PathEstimate path() const override;
  std::optional<ClosedLoop> closedLoop() const override { return map_.closedLoop(); }
  bool keepsJointMap() const override { return map_.isKept(); }
  std::function<SavedMap()> savedMap() const override;
  void relocaliseIn(std::shared_ptr<const SavedMap> map) override { map_.relocaliseIn(std::move(map)); }
  void resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source, double max_gap_s) override;
  MapUse mapUse() const override { return resume_map_ ? MapUse::kWaiting : map_.use(); }

 private:
  void begin(const SE3& pose, const Matrix6d& covariance);
  void moveWorld(const SE3& to_T_world);
  std::optional<StereoRig> givenRig() const { return model_ ? std::optional(model_->rig()) : std::nullopt; }
  void advanceTo(Stamp stamp);
  void guessTwistOf(const StereoFrame& frame);
  void propagate(Filter& filter, const ImuTrack& imu, Stamp from, Stamp to) const;
  std::optional<Filter> ahead(Stamp end, double known_tilt) const;
  void checkpoint(bool thoroughly);
  void useFeatures(const StereoFrame& frame, FrameReport& report);
  void updateTracks(const StereoFrame& frame, const Associations& seen, const FrameOutcome& outcome,
                    FrameReport& report);
  void initialise(const StereoFrame& frame, const std::vector<std::size_t>& features, FrameReport& report);

  struct LastFrame {
    Stamp stamp;
    Eigen::Vector3d position; ///< of the body, world, m
  };

  /// Of the last frame; 0 before the first.
  double secondsSinceFrame(Stamp stamp) const {
    return last_frame_ ? secondsBetween(last_frame_->stamp, stamp) : 0.0;
  }

  InvariantConfig config_;
  std::shared_ptr<MotionModel> motion_; ///< shared by copies; has no state but its variables' handles
  ImuTrack imu_;
  std::optional<StereoModel> model_;
  TrackSlip slip_;
  Filter filter_;
  JointMap map_;
  StandstillDetector standstill_;
  Recovery recovery_;
  TrackStatus tracks_;
  bool is_starting_ = false;
  std::size_t contradicting_velocities_ = 0; ///< since the last frame
  std::optional<Stamp> stamp_;
  std::optional<LastFrame> last_frame_;
  std::shared_ptr<const SavedMap> resume_map_; ///< to go on from, if the first measurement comes soon enough
  double max_gap_s_ = 0.0;                     ///< s after it
};

} // namespace vi_ekf_slam
