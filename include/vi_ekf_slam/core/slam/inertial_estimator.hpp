#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/slam/inertial_alignment.hpp"

namespace vi_ekf_slam {

/// The right-invariant EKF of a body with an IMU, and how it starts: from a given state, from a saved one, or
/// by itself, at rest and in motion alike: where the pictures and the IMU of the first moments are aligned
/// the filter begins, wide open, with the measurements of these moments. So each of them is used once, and
/// the alignment is where it is linearised.
class InertialEstimator : public Estimator {
 public:
  explicit InertialEstimator(const InvariantConfig& config);

  void setRig(const StereoRig& rig) override;
  void setBiasPrior(const TwistBias& bias) override;
  bool begin(const InitialState& state) override;
  std::optional<SE3> startPose() const override { return std::nullopt; }
  bool hasStarted() const override { return filter_ != nullptr; }
  std::string startProblem() const override { return filter_ ? std::string() : refusal_ + problem_; }
  std::string contradiction() const override { return contradiction_; }
  void expect(const ImuSample& next) override;
  void process(const ImuSample& sample) override;
  void process(const VelocitySample& sample) override;
  FrameReport process(const StereoFrame& frame) override;
  void setGates(const Gates& gates) override;
  bool setPose(const SE3& world_T_imu, const Matrix6d& covariance) override {
    return filter_ && filter_->setPose(world_T_imu, covariance);
  }
  bool canBridge(double gap_s) const override { return !filter_ || filter_->canBridge(gap_s); }
  Forecast forecast() const override { return filter_ ? filter_->forecast() : forecast_; }
  void beginAt(Forecast forecast) override { forecast_ = std::move(forecast); }
  StateEstimate state() const override { return filter_ ? filter_->state() : alignment_->state(); }
  std::optional<RigEstimate> rig() const override { return filter_ ? filter_->rig() : std::nullopt; }
  double timeOffset() const override { return filter_ ? filter_->timeOffset() : config_.rig.time_offset; }
  std::vector<LandmarkEstimate> landmarks() const override {
    return filter_ ? filter_->landmarks() : std::vector<LandmarkEstimate>();
  }
  std::function<MapEstimate()> exactMap() const override {
    return filter_ ? filter_->exactMap() : Estimator::exactMap();
  }
  PathEstimate path() const override { return filter_ ? filter_->path() : PathEstimate(); }
  std::optional<ClosedLoop> closedLoop() const override {
    return filter_ ? filter_->closedLoop() : std::nullopt;
  }
  bool keepsJointMap() const override { return config_.map.keep != MapKeep::kNone; }
  std::function<SavedMap()> savedMap() const override {
    return filter_ ? filter_->savedMap() : Estimator::savedMap();
  }
  void relocaliseIn(std::shared_ptr<const SavedMap> map) override;
  void resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source, double max_gap_s) override;
  MapUse mapUse() const override {
    return filter_ ? filter_->mapUse() : map_ ? MapUse::kWaiting : MapUse::kNone;
  }

 private:
  template <class Tell>
  void tellAll(const Tell& tell);
  void tryToGoOn(Stamp now);
  void tryGiven(Stamp now);
  std::string tryToStart(Stamp now);
  void verify(const StereoFrame& frame, Divergence divergence);
  std::string replay(InvariantEstimator& filter) const;
  bool learnClock(const InvariantEstimator& filter);

  InvariantConfig config_;
  std::shared_ptr<const SavedMap> map_; ///< to find the place in, or to go on from
  std::unique_ptr<InvariantEstimator> filter_;
  std::unique_ptr<InertialAlignment> alignment_; ///< until there is a filter, and while it is verified
  int divergences_ = 0;                          ///< since it is
  Stamp suspect_at_ = 0;                         ///< when it last diverged or contradicted the pictures
  // Until there is a filter.
  std::unique_ptr<InvariantEstimator> resuming_; ///< from map_
  std::optional<InitialState> given_;
  Forecast forecast_;   ///< of where it begins
  std::string refusal_; ///< of the given state
  std::string problem_, contradiction_;
};

} // namespace vi_ekf_slam
