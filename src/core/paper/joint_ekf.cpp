#include "vi_ekf_slam/core/paper/joint_ekf.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

namespace vi_ekf_slam::paper {

JointEkf::JointEkf(const PaperConfig& config)
    : config_(config), covariance_(Eigen::MatrixXd::Zero(306, 306)) {
  covariance_.topLeftCorner<6, 6>() = config.prior_pose_variance * Matrix6d::Identity();
}

void JointEkf::predict(const Vector6d& twist, double tau, const Matrix6d& W) {
  InversePose pose{imu_T_world_, poseCovariance()};
  paper::predict(twist, tau, W, pose);
  imu_T_world_ = pose.imu_T_world;
  covariance_.topLeftCorner<6, 6>() = pose.covariance;
  const Eigen::Index map_size = size_ - 6;
  auto cross = covariance_.block(0, 6, 6, map_size);
  cross = (errorTransition(twist, tau) * cross).eval();
  covariance_.block(6, 0, map_size, 6) = cross.transpose();
}

FrameReport JointEkf::update(const StereoRig& rig, const StereoFrame& frame) {
  FrameReport report;
  report.stamp = frame.stamp;
  report.features = frame.features.size();
  std::vector<Match> matches;
  std::vector<const StereoFeatureObservation*> unknown;
  for (const auto& feature : frame.features) {
    if (!isSelected(feature.id, config_.landmark_fraction)) continue;
    if (!isPlausible(feature.pixels)) {
      ++report.invalid;
      continue;
    }
    const auto known = index_of_id_.find(feature.id);
    if (known == index_of_id_.end()) {
      unknown.push_back(&feature);
      continue;
    }
    const auto prediction =
        predictObservation(rig, imu_T_world_, positions_[known->second], config_.min_depth_m);
    if (!prediction) {
      ++report.rejected;
      continue;
    }
    matches.push_back({6 + 3 * static_cast<Eigen::Index>(known->second), *prediction, feature.pixels});
  }
  if (!matches.empty()) report.frame_rejected = !correct(matches, report);
  if (report.frame_rejected) unknown.clear();
  for (const auto* feature : unknown) {
    const auto position = initialLandmark(rig, imu_T_world_, feature->pixels, config_);
    if (position) {
      append(feature->id, *position);
      ++report.initialised;
    } else {
      ++report.invalid;
    }
  }
  report.landmarks = positions_.size();
  return report;
}

bool JointEkf::correct(const std::vector<Match>& matches, FrameReport& report) {
  const Eigen::Index n = size_, rows = 4 * static_cast<Eigen::Index>(matches.size());
  const auto P = covariance_.topLeftCorner(n, n);
  Eigen::MatrixXd HP(rows, n);
  Eigen::VectorXd innovation(rows);
  Eigen::Index row = 0;
  for (const Match& match : matches) {
    HP.middleRows<4>(row).noalias() = match.prediction.by_pose * P.topRows<6>();
    HP.middleRows<4>(row).noalias() += match.prediction.by_landmark * P.middleRows<3>(match.offset);
    innovation.segment<4>(row) = match.pixels - match.prediction.pixels;
    row += 4;
  }
  Eigen::MatrixXd S(rows, rows);
  row = 0;
  for (const Match& match : matches) {
    S.middleCols<4>(row).noalias() = HP.leftCols<6>() * match.prediction.by_pose.transpose();
    S.middleCols<4>(row).noalias() +=
        HP.middleCols<3>(match.offset) * match.prediction.by_landmark.transpose();
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
  auto P_used = covariance_.topLeftCorner(n, n);
  P_used.selfadjointView<Eigen::Lower>().rankUpdate(HP.transpose(), -1.0);
  P_used.triangularView<Eigen::StrictlyUpper>() = P_used.transpose();

  imu_T_world_ = corrected;
  for (std::size_t i = 0; i < positions_.size(); ++i) {
    positions_[i] += correction.segment<3>(6 + 3 * static_cast<Eigen::Index>(i));
  }
  report.used = matches.size();
  report.nis = innovation.dot(weighted);
  report.nis_dof = static_cast<std::size_t>(rows);
  return true;
}

void JointEkf::append(FeatureId id, const Eigen::Vector3d& position) {
  index_of_id_[id] = positions_.size();
  positions_.push_back(position);
  if (size_ + 3 > covariance_.rows()) {
    Eigen::MatrixXd larger = Eigen::MatrixXd::Zero(2 * covariance_.rows(), 2 * covariance_.rows());
    larger.topLeftCorner(size_, size_) = covariance_.topLeftCorner(size_, size_);
    covariance_.swap(larger);
  }
  // The capacity beyond size_ has never been written, so the cross-covariances are zero already.
  covariance_.block<3, 3>(size_, size_) = config_.prior_landmark_variance * Eigen::Matrix3d::Identity();
  size_ += 3;
}

std::vector<LandmarkEstimate> JointEkf::landmarks() const {
  std::vector<LandmarkEstimate> all;
  all.reserve(positions_.size());
  for (const auto& [id, index] : index_of_id_) {
    const Eigen::Index offset = 6 + 3 * static_cast<Eigen::Index>(index);
    all.push_back({id, positions_[index], covariance_.block<3, 3>(offset, offset)});
  }
  return all;
}

} // namespace vi_ekf_slam::paper
