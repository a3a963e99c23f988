#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "vi_ekf_slam/core/paper/inverse_pose.hpp"
#include "vi_ekf_slam/core/paper/observation.hpp"
#include "vi_ekf_slam/core/run/config.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"

namespace vi_ekf_slam::paper {

/// Joint EKF over inverse pose and landmarks (eq. 9 to 20), covariance (6 + 3M) x (6 + 3M), the pose first.
/// Landmarks enter with the prior variance and no correlation, and never leave.
class JointEkf {
 public:
  explicit JointEkf(const PaperConfig& config);

  /// Eq. 11, the landmarks standing still. `W` is the 6x6 of this step.
  void predict(const Vector6d& twist, double tau, const Matrix6d& W);

  /// Updates with the landmarks that are known (eq. 17 and 20 jointly), then initialises the new ones. A
  /// frame without a finite correction is rejected as a whole and changes nothing.
  FrameReport update(const StereoRig& rig, const StereoFrame& frame);

  const SE3& imuTWorld() const { return imu_T_world_; }
  Matrix6d poseCovariance() const { return covariance_.topLeftCorner<6, 6>(); }
  std::vector<LandmarkEstimate> landmarks() const;
  /// The whole joint covariance, (6 + 3M) square; landmarks in the order in which they entered.
  Eigen::Ref<const Eigen::MatrixXd> covariance() const { return covariance_.topLeftCorner(size_, size_); }

 private:
  struct Match {
    Eigen::Index offset; ///< of the landmark in the state
    PredictedObservation prediction;
    StereoPixels pixels;
  };

  /// False, and nothing changed, where the numbers do not allow a finite correction.
  bool correct(const std::vector<Match>& matches, FrameReport& report);
  void append(FeatureId id, const Eigen::Vector3d& position);

  PaperConfig config_;
  SE3 imu_T_world_;
  std::vector<Eigen::Vector3d> positions_;       ///< world, m, in the order in which they entered
  std::map<FeatureId, std::size_t> index_of_id_; ///< into positions_
  Eigen::MatrixXd covariance_;                   ///< capacity; the top left size_ x size_ is in use
  Eigen::Index size_ = 6;
};

} // namespace vi_ekf_slam::paper
