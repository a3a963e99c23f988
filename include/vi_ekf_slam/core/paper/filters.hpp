#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "vi_ekf_slam/core/paper/models.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"

namespace vi_ekf_slam::paper {

/// What both filters do. Landmarks enter with the prior variance and no correlation, and never leave.
class LandmarkFilter {
 public:
  std::vector<LandmarkEstimate> landmarks() const;

 protected:
  struct Match {
    std::size_t landmark; ///< its index, in the order in which they entered
    PredictedObservation prediction;
    StereoPixels pixels;
  };

  explicit LandmarkFilter(const PaperConfig& config) : config_(config) {}
  ~LandmarkFilter() = default;

  /// Of a frame seen from this inverse pose: corrects by the landmarks that are known, then initialises the
  /// new ones from the pose as it is by then. A frame without a finite correction is rejected as a whole and
  /// changes nothing.
  FrameReport update(const StereoRig& rig, const SE3& imu_T_world, const StereoFrame& frame);

  /// False, and nothing changed, where the numbers do not allow a finite correction.
  virtual bool correct(const std::vector<Match>& matches, FrameReport& report) = 0;
  /// The last one of positions_ is new.
  virtual void grow() = 0;
  virtual Eigen::Matrix3d covarianceOf(std::size_t landmark) const = 0;

  PaperConfig config_;
  std::vector<Eigen::Vector3d> positions_; ///< world, m

 private:
  std::map<FeatureId, std::size_t> index_of_id_; ///< into positions_
};

/// Landmark EKF along a given trajectory (eq. 13 to 17).
///
/// The joint covariance is 3M x 3M. With the pose given and V the same for every pixel no update ever couples
/// two landmarks, so all its off-diagonal blocks stay exactly zero and only the diagonal ones are stored.
class LandmarkMapper final : public LandmarkFilter {
 public:
  explicit LandmarkMapper(const PaperConfig& config) : LandmarkFilter(config) {}

  using LandmarkFilter::update;

 private:
  bool correct(const std::vector<Match>& matches, FrameReport& report) override;
  void grow() override;
  Eigen::Matrix3d covarianceOf(std::size_t landmark) const override { return covariances_[landmark]; }

  std::vector<Eigen::Matrix3d> covariances_;
};

/// Joint EKF over inverse pose and landmarks (eq. 9 to 20), covariance (6 + 3M) x (6 + 3M), the pose first.
class JointEkf final : public LandmarkFilter {
 public:
  explicit JointEkf(const PaperConfig& config);

  /// Eq. 11, the landmarks standing still. `W` is the 6x6 of this step.
  void predict(const Vector6d& twist, double tau, const Matrix6d& W);

  /// Eq. 17 and 20 jointly.
  FrameReport update(const StereoRig& rig, const StereoFrame& frame) {
    return LandmarkFilter::update(rig, imu_T_world_, frame);
  }

  const SE3& imuTWorld() const { return imu_T_world_; }
  Matrix6d poseCovariance() const { return covariance_.topLeftCorner<6, 6>(); }
  /// The whole joint covariance, (6 + 3M) square; landmarks in the order in which they entered.
  Eigen::Ref<const Eigen::MatrixXd> covariance() const { return covariance_.topLeftCorner(size_, size_); }

 private:
  bool correct(const std::vector<Match>& matches, FrameReport& report) override;
  void grow() override;
  Eigen::Matrix3d covarianceOf(std::size_t landmark) const override;

  SE3 imu_T_world_;
  Eigen::MatrixXd covariance_; ///< capacity; the top left size_ x size_ is in use
  Eigen::Index size_ = 6;
};

} // namespace vi_ekf_slam::paper
