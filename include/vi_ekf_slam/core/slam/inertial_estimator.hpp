#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/motion/gravity_fit.hpp"
#include "vi_ekf_slam/core/slam/invariant_estimator.hpp"

namespace vi_ekf_slam {

/// The right-invariant EKF of a body with an IMU, and how it starts: from a given state, from a saved one, or
/// by itself, at rest and in motion alike. Visual odometry over the first moments says how the IMU moved, a
/// linear fit what gravity, velocity and the gyro's bias were; there the filter begins, wide open, with the
/// measurements of these moments. So each of them is used once, and the fit is where it is linearised.
class InertialEstimator : public Estimator {
 public:
  explicit InertialEstimator(const InvariantConfig& config);

  void setRig(const StereoRig& rig) override;
  void setBiasPrior(const TwistBias& bias) override;
  bool begin(const InitialState& state) override;
  std::optional<SE3> startPose() const override { return std::nullopt; }
  bool hasStarted() const override { return filter_ != nullptr; }
  std::string startProblem() const override { return filter_ ? std::string() : problem_; }
  void expect(const ImuSample& next) override;
  void process(const ImuSample& sample) override;
  void process(const VelocitySample& sample) override;
  FrameReport process(const StereoFrame& frame) override;
  void setGates(const Gates& gates) override;
  bool setPose(const SE3& world_T_imu, const Matrix6d& covariance) override {
    return filter_ && filter_->setPose(world_T_imu, covariance);
  }
  bool canBridge(double gap_s) const override { return !filter_ || filter_->canBridge(gap_s); }
  StateEstimate state() const override;
  std::optional<RigEstimate> rig() const override { return filter_ ? filter_->rig() : std::nullopt; }
  double timeOffset() const override { return filter_ ? filter_->timeOffset() : config_.rig.time_offset; }
  std::vector<LandmarkEstimate> landmarks() const override;
  std::function<MapEstimate()> exactMap() const override;
  PathEstimate path() const override { return filter_ ? filter_->path() : PathEstimate(); }
  std::optional<ClosedLoop> closedLoop() const override {
    return filter_ ? filter_->closedLoop() : std::nullopt;
  }
  bool keepsJointMap() const override { return config_.map.keep != MapKeep::kNone; }
  std::function<SavedMap()> savedMap() const override;
  void relocaliseIn(std::shared_ptr<const SavedMap> map) override;
  void resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source, double max_gap_s) override;
  MapUse mapUse() const override;

 private:
  std::unique_ptr<InvariantEstimator> makeFilter() const;
  void beginOdometry();
  void tryToGoOn(Stamp now);
  void tryGiven(Stamp now);
  void orderWindow();
  void tryToStart();
  std::string startFrom(const std::vector<SeenPose>& poses);
  bool replay(InvariantEstimator& filter) const;
  bool learnClock(const InvariantEstimator& filter);
  void forgetOld(Stamp now);

  InvariantConfig config_;
  std::optional<StereoRig> rig_;
  std::optional<TwistBias> bias_;
  std::shared_ptr<const SavedMap> map_; ///< to find the place in
  std::unique_ptr<InvariantEstimator> filter_;
  // Until there is a filter.
  std::unique_ptr<InvariantEstimator> resuming_; ///< from resume_map_
  std::shared_ptr<const SavedMap> resume_map_;
  std::optional<InitialState> given_;
  std::optional<InvariantEstimator> odometry_; ///< of the pictures and the gyro
  std::deque<Measurement> window_;
  ImuTrack imu_; ///< all of the IMU's samples so far
  std::deque<SeenPose> poses_;
  std::string problem_;
};

} // namespace vi_ekf_slam
