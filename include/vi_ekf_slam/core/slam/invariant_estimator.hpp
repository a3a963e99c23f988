#pragma once

#include <memory>
#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "vi_ekf_slam/core/map/place_loops.hpp"
#include "vi_ekf_slam/core/map/relocaliser.hpp"
#include "vi_ekf_slam/core/motion/standstill.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"
#include "vi_ekf_slam/core/slam/invariant_config.hpp"
#include "vi_ekf_slam/core/tracking/standing_track.hpp"

namespace vi_ekf_slam {

/// The right-invariant EKF SLAM: what wires the rooms, in the order in which a measurement passes through
/// them (docs/architecture.md).
class InvariantEstimator : public Estimator {
 public:
  explicit InvariantEstimator(const InvariantConfig& config);

  void setRig(const StereoRig& rig) override;
  void setBiasPrior(const TwistBias& bias) override { motion_->setBiasPrior(filter_, bias); }
  void process(const GyroSample& sample) override;
  void process(const VelocitySample& sample) override;
  FrameReport process(const StereoFrame& frame) override;
  void setGates(const Gates& gates) override;
  bool canBridge(double gap_s) const override;
  StateEstimate state() const override;
  std::vector<LandmarkEstimate> landmarks() const override;
  std::function<std::vector<LandmarkEstimate>()> exactMap() const override;
  bool keepsJointMap() const override { return map_.keepsInactive(); }
  std::function<SavedMap()> savedMap() const override;
  void relocaliseIn(std::shared_ptr<const SavedMap> map) override;
  void resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source, double max_gap_s) override;
  MapUse mapUse() const override { return map_use_; }

 private:
  void begin(const SE3& pose, const Matrix6d& covariance);
  void advanceTo(Stamp stamp);
  void propagate(Filter& filter, double dt) const;
  void checkpoint(bool thoroughly);
  void handleStandstill(const StereoFrame& frame);
  std::vector<std::size_t> usableFeatures(const StereoFrame& frame, FrameReport& report);
  void useFeatures(const StereoFrame& frame, FrameReport& report);
  bool hasStood(FeatureId id, const StereoPixels& pixels);
  bool isBelieved(const StereoFrame& frame, const Associations& seen);
  bool isAnotherView(const StereoFrame& frame, const Associations& seen);
  void beginMapAnew(const StereoFrame& frame, const std::vector<std::size_t>& usable, FrameReport& report);
  void loseAll();
  void updateTracks(const StereoFrame& frame, const Associations& seen, const FrameOutcome& outcome,
                    FrameReport& report);
  void initialise(const StereoFrame& frame, const std::vector<std::size_t>& features, FrameReport& report);
  void closeLoops(FrameReport& report);
  void resume(Stamp stamp);

  /// A saved map to go on from with the first measurement, if that comes soon enough.
  struct Resume {
    std::shared_ptr<const SavedMap> map;
    double max_gap_s;
  };

  InvariantConfig config_;
  std::shared_ptr<MotionModel> motion_; ///< shared by copies; has no state but its variables' handles
  std::optional<Handle> scale_;
  std::optional<StereoModel> model_;
  TrackSlip slip_;
  Filter filter_;
  LandmarkMap map_;
  StandstillDetector standstill_;
  Recovery recovery_;
  ReturningLandmarks returning_;
  PlaceLoops places_;
  std::optional<Relocaliser> relocaliser_;
  std::optional<Resume> resume_;
  MapUse map_use_ = MapUse::kNone;
  /// Tracks in view that contradicted the static world, and where they have stood since.
  std::unordered_map<FeatureId, std::optional<StandingTrack>> rejected_;
  std::unordered_set<FeatureId> suspects_; ///< in view, that once did
  StandingTracks skipped_;                 ///< of the frames that were skipped since the last used one
  std::optional<Stamp> stamp_, last_frame_;
  std::optional<Stamp> last_used_; ///< frame that corrected the local map, or began it
  Eigen::Vector3d last_position_ = Eigen::Vector3d::Zero(); ///< world, m, at the last frame
  Divergence divergence_ = Divergence::kNone;               ///< to be reported with the next frame
};

} // namespace vi_ekf_slam
