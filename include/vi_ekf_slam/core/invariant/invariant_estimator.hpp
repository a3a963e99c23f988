#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "vi_ekf_slam/core/invariant/archive.hpp"
#include "vi_ekf_slam/core/invariant/config.hpp"
#include "vi_ekf_slam/core/invariant/drift.hpp"
#include "vi_ekf_slam/core/invariant/frame_update.hpp"
#include "vi_ekf_slam/core/invariant/jump.hpp"
#include "vi_ekf_slam/core/invariant/scale_monitor.hpp"
#include "vi_ekf_slam/core/invariant/standstill.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/invariant/stereo_update.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"

namespace vi_ekf_slam::invariant {

/// The right-invariant EKF with a twist state: gyro, velocity and stereo frames are measurements of one
/// state, each at its own rate. A landmark whose track ends goes from the active state to the inactive ones
/// of the joint covariance, or to the archive; when its id returns, what was seen since and what was seen
/// before are fused.
class InvariantEstimator : public Estimator {
 public:
  explicit InvariantEstimator(const InvariantConfig& config);

  void setRig(const StereoRig& rig) override;
  void process(const GyroSample& sample) override;
  void process(const VelocitySample& sample) override;
  FrameReport process(const StereoFrame& frame) override;
  void setGates(const Gates& gates) override;
  StateEstimate state() const override;
  std::vector<LandmarkEstimate> landmarks() const override;
  std::function<std::vector<LandmarkEstimate>()> exactMap() const override;
  bool keepsJointMap() const override { return state_.keepsInactive(); }
  std::function<SavedMap()> savedMap() const override;
  void relocaliseIn(std::shared_ptr<const SavedMap> map) override;
  void resumeFrom(std::shared_ptr<const SavedMap> map, double max_gap_s) override;
  MapUse mapUse() const override { return map_use_; }

 private:
  static State initialState(const InvariantConfig& config);
  void advanceTo(Stamp stamp);
  void measure(Eigen::Index axis, const Eigen::Vector3d& measured, const Eigen::Matrix3d& noise);
  void gradeBias(Eigen::Index axis, const Eigen::Matrix3d& noise, double configured_sigma, bool& done);
  void handleStandstill(const StereoFrame& frame);
  void forgetOutcastsNotIn(const StereoFrame& frame);
  void keepRotationVariance();
  Matrix6d poseCovariance() const;
  bool isSound(bool thoroughly) const;
  void keepSound(bool thoroughly);
  Divergence judge(const StereoFrame& frame, const PooledVector<Observation>& observations,
                   const FrameOutcome& outcome);
  std::vector<Displaced> displacedPoints(const StereoFrame& frame,
                                         const PooledVector<Observation>& observations) const;
  bool isJump(const SE3& motion) const;
  void followJump(const SE3& motion);
  void doubtAll();
  void rebuild();
  void doubt(double position_sigma, double rotation_sigma);
  void doubt(const SE3& motion, const Matrix6d& covariance);
  Manoeuvre manoeuvreSince(std::optional<Stamp> last_frame) const;
  bool isUsable(const StereoPixels& pixels) const;
  PooledVector<Observation> match(const StereoFrame& frame, const PooledVector<std::size_t>& usable,
                                  PooledVector<std::size_t>& unknown, PooledVector<bool>& seen) const;
  void remove(const PooledVector<bool>& keep, FrameReport& report);
  void initialise(const StereoFrame& frame, const PooledVector<std::size_t>& features, FrameReport& report);
  LandmarkEstimate estimateOf(std::size_t landmark) const;
  std::vector<LandmarkEstimate> landmarks(InactiveMap::Covariances covariances) const;
  void retire(std::size_t landmark);
  Eigen::Matrix3d slideOf(const Landmark& landmark) const;
  void boundInactive();
  void archiveInactive();
  void keepRecalled(const StereoFrame& frame, const PooledVector<std::size_t>& unknown,
                    PooledVector<bool>& keep, FrameReport& report);
  void revisit(FrameReport& report);
  std::size_t fuseReturned(std::vector<FeatureId> ids, std::size_t least);
  void resume(Stamp stamp);
  void relocalise(FrameReport& report);
  std::vector<FeatureId> agreeingWithMap(SE3& map_T_session) const;
  bool moveIntoMap(const SE3& map_T_session, const std::vector<FeatureId>& ids);
  void recognisePlace(FrameReport& report);
  std::vector<FeatureId> soonInView() const;
  bool isLongOutOfView(FeatureId inactive) const;
  bool isLocated(std::size_t landmark) const;

  /// What is left when mean or covariance break.
  struct Sound {
    Stamp stamp = 0;
    SE3 pose;
    Matrix6d pose_covariance = Matrix6d::Zero(); ///< the state's, along the world axes
    Eigen::Vector3d rotation_variance = Eigen::Vector3d::Zero();
    Drift drift;
  };

  /// A map that this drive has not found its place in yet.
  struct LoadedMap {
    std::shared_ptr<const SavedMap> map;
    std::unordered_map<FeatureId, std::size_t> index; ///< of its landmarks, by id
    int frames_until_attempt = 0;
  };

  InvariantConfig config_;
  State state_;
  ScaleMonitor scale_;
  Drift drift_;
  Eigen::Vector3d rotation_variance_ = Eigen::Vector3d::Zero(); ///< published with the last frame, rad^2
  StandstillDetector standstill_;
  DivergenceMonitor monitor_;
  Sound sound_;
  double distance_ = 0.0;                     ///< m driven since the last frame
  double driven_ = 0.0;                       ///< m driven since the start
  double angle_ = 0.0;                        ///< rad turned since the last frame
  Divergence divergence_ = Divergence::kNone; ///< to be reported with the next frame
  std::optional<StereoModel> model_;
  double baseline_ = 0.0; ///< m, as calibrated
  std::optional<Stamp> stamp_;
  std::optional<Stamp> last_frame_;
  std::optional<GyroSample> last_gyro_;
  bool gyro_graded_ = false, velocity_graded_ = false; ///< see gradeBias
  PooledHashSet<FeatureId> outcasts_;                  ///< tracks in view that contradicted the world
  std::size_t last_used_ = 0;                          ///< features used by the last frame
  Archive archive_;
  std::unordered_map<FeatureId, int> recalled_; ///< expected back in view, and for how many frames more
  std::unordered_set<FeatureId> disputed_;      ///< in view, and not where they were seen before
  double settling_allowance_ = 0.0;             ///< operations, see revisit
  bool loop_closed_ = false;                    ///< by this frame, with what was seen long ago
  int frames_until_recognition_ = 0;            ///< see recognisePlace
  std::shared_ptr<const SavedMap> resumed_;     ///< to go on from with the first measurement
  double max_gap_s_ = 0.0;                      ///< until that
  std::optional<LoadedMap> loaded_;
  MapUse map_use_ = MapUse::kNone;
};

} // namespace vi_ekf_slam::invariant
