#include "vi_ekf_slam/core/paper/filters.hpp"

#include <Eigen/Cholesky>

namespace vi_ekf_slam::paper {
namespace {

/// Of a landmark in the joint state.
Eigen::Index rowOf(std::size_t landmark) { return 6 + 3 * static_cast<Eigen::Index>(landmark); }

} // namespace

FrameReport LandmarkFilter::update(const StereoRig& rig, const SE3& imu_T_world, const StereoFrame& frame) {
  FrameReport report(frame);
  std::vector<Match> matches;
  std::vector<const StereoFeatureObservation*> unknown;
  for (const auto& feature : frame.features) {
    if (!isSelected(feature.id, config_.landmark_fraction)) continue;
    const auto known = index_of_id_.find(feature.id);
    if (!isPlausible(feature.pixels)) {
      ++report.invalid;
    } else if (known == index_of_id_.end()) {
      unknown.push_back(&feature);
    } else if (const auto prediction =
                   predictObservation(rig, imu_T_world, positions_[known->second], config_.min_depth_m)) {
      matches.push_back({known->second, *prediction, feature.pixels});
    } else {
      ++report.rejected;
    }
  }
  report.frame_rejected = !matches.empty() && !correct(matches, report);
  if (report.frame_rejected) unknown.clear();
  for (const auto* feature : unknown) {
    const auto position = initialLandmark(rig, imu_T_world, feature->pixels, config_);
    if (position) {
      index_of_id_[feature->id] = positions_.size();
      positions_.push_back(*position);
      grow();
    }
    ++(position ? report.initialised : report.invalid);
  }
  report.landmarks = positions_.size();
  return report;
}

std::vector<LandmarkEstimate> LandmarkFilter::landmarks() const {
  std::vector<LandmarkEstimate> all;
  all.reserve(positions_.size());
  for (const auto& [id, index] : index_of_id_) all.push_back({id, positions_[index], covarianceOf(index)});
  return all;
}

/// Eq. 17, landmark by landmark.
bool LandmarkMapper::correct(const std::vector<Match>& matches, FrameReport& report) {
  for (const Match& match : matches) {
    Eigen::Matrix3d& P = covariances_[match.landmark];
    const Eigen::Matrix<double, 4, 3>& H = match.prediction.by_landmark;
    const Eigen::Matrix<double, 4, 3> HP = H * P;
    const Eigen::LLT<Eigen::Matrix4d> S(HP * H.transpose() +
                                        config_.pixel_noise * Eigen::Matrix4d::Identity());
    const Eigen::Vector4d innovation = match.pixels - match.prediction.pixels;
    positions_[match.landmark] += HP.transpose() * S.solve(innovation);
    const Eigen::Matrix<double, 4, 3> A = S.matrixL().solve(HP);
    P -= A.transpose() * A;
    report.nis += innovation.dot(S.solve(innovation));
  }
  report.used = matches.size();
  report.nis_dof = 4 * matches.size();
  return true;
}

void LandmarkMapper::grow() {
  covariances_.push_back(config_.prior_landmark_variance * Eigen::Matrix3d::Identity());
}

JointEkf::JointEkf(const PaperConfig& config)
    : LandmarkFilter(config), covariance_(Eigen::MatrixXd::Zero(306, 306)) {
  covariance_.topLeftCorner<6, 6>() = config.prior_pose_variance * Matrix6d::Identity();
}

void JointEkf::predict(const Vector6d& twist, double tau, const Matrix6d& W) {
  paper::predict(twist, tau, W, imu_T_world_, covariance_.topLeftCorner<6, 6>());
  const Eigen::Index map_size = size_ - 6;
  auto cross = covariance_.block(0, 6, 6, map_size);
  cross = (errorTransition(twist, tau) * cross).eval();
  covariance_.block(6, 0, map_size, 6) = cross.transpose();
}

bool JointEkf::correct(const std::vector<Match>& matches, FrameReport& report) {
  const Eigen::Index rows = 4 * static_cast<Eigen::Index>(matches.size());
  auto P = covariance_.topLeftCorner(size_, size_);
  Eigen::MatrixXd HP(rows, size_), S(rows, rows);
  Eigen::VectorXd innovation(rows);
  Eigen::Index row = 0;
  for (const auto& [landmark, prediction, pixels] : matches) {
    HP.middleRows<4>(row).noalias() = prediction.by_pose * P.topRows<6>();
    HP.middleRows<4>(row).noalias() += prediction.by_landmark * P.middleRows<3>(rowOf(landmark));
    innovation.segment<4>(row) = pixels - prediction.pixels;
    row += 4;
  }
  row = 0;
  for (const auto& [landmark, prediction, pixels] : matches) {
    S.middleCols<4>(row).noalias() = HP.leftCols<6>() * prediction.by_pose.transpose();
    S.middleCols<4>(row).noalias() += HP.middleCols<3>(rowOf(landmark)) * prediction.by_landmark.transpose();
    row += 4;
  }
  S.diagonal().array() += config_.pixel_noise;
  const Eigen::LLT<Eigen::MatrixXd> llt(S);
  if (llt.info() != Eigen::Success) return false;

  // P - K H P with K = P H^T S^-1 is P - A^T A with A = L^-1 H P: symmetric by construction.
  const Eigen::VectorXd weighted = llt.solve(innovation);
  const Eigen::VectorXd correction = HP.transpose() * weighted;
  llt.matrixL().solveInPlace(HP);
  const SE3 corrected = (SE3::Exp(correction.head<6>()) * imu_T_world_).normalized();
  if (!correction.allFinite() || !HP.allFinite() || !corrected.matrix().allFinite()) return false;
  P.selfadjointView<Eigen::Lower>().rankUpdate(HP.transpose(), -1.0);
  P.triangularView<Eigen::StrictlyUpper>() = P.transpose();

  imu_T_world_ = corrected;
  for (std::size_t i = 0; i < positions_.size(); ++i) positions_[i] += correction.segment<3>(rowOf(i));
  report.used = matches.size();
  report.nis = innovation.dot(weighted);
  report.nis_dof = static_cast<std::size_t>(rows);
  return true;
}

void JointEkf::grow() {
  if (size_ + 3 > covariance_.rows()) {
    Eigen::MatrixXd larger = Eigen::MatrixXd::Zero(2 * covariance_.rows(), 2 * covariance_.rows());
    larger.topLeftCorner(size_, size_) = covariance_.topLeftCorner(size_, size_);
    covariance_.swap(larger);
  }
  // The capacity beyond size_ has never been written, so the cross-covariances are zero already.
  covariance_.block<3, 3>(size_, size_) = config_.prior_landmark_variance * Eigen::Matrix3d::Identity();
  size_ += 3;
}

Eigen::Matrix3d JointEkf::covarianceOf(std::size_t landmark) const {
  return covariance_.block<3, 3>(rowOf(landmark), rowOf(landmark));
}

} // namespace vi_ekf_slam::paper
