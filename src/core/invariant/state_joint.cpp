// The joint covariance of State as a whole: out, in, and into another frame.

#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/invariant/symmetric.hpp"

namespace vi_ekf_slam::invariant {

/// dp = xi_p - [p]x xi_R and d = e - [m]x xi_R, for `rows` of (xi, dnu, db, e).
void State::turnToWorldAxes(Eigen::Ref<Eigen::MatrixXd> rows) const {
  if (rows.cols() == 0) return; // no part of an empty matrix
  const Eigen::Matrix<double, 3, Eigen::Dynamic> rotation = rows.middleRows<3>(kRotation);
  rows.middleRows<3>(kPosition).noalias() -= so3::hat(pose_.translation()) * rotation;
  for (std::size_t i = 0; i < landmarks_.size(); ++i)
    rows.middleRows<3>(offsetOf(i)).noalias() -= so3::hat(landmarks_[i].position) * rotation;
}

State::Joint State::joint(const std::vector<std::size_t>& active) {
  Eigen::MatrixXd P = covariance();
  onBothSides(P, [this](Eigen::Ref<Eigen::MatrixXd>& rows) { turnToWorldAxes(rows); });
  Joint joint;
  std::vector<std::size_t> order;
  Eigen::MatrixXd cross(size(), 0);
  if (inactive_) {
    inactive_->settle(size(), 0);
    order = inactive_->settledByAge();
    cross = inactive_->settledCross();
    turnToWorldAxes(cross);
  }
  const std::size_t inactive = order.size();
  Eigen::MatrixXd& C = joint.covariance;
  C.resize(offsetOf(inactive + active.size()), offsetOf(inactive + active.size()));
  C.topLeftCorner<kLandmarks, kLandmarks>() = P.topLeftCorner<kLandmarks, kLandmarks>();
  // The lower triangle: column by column, rows of the base, of inactive and of active landmarks.
  for (std::size_t j = 0; j < inactive; ++j) {
    const Eigen::Index from = 3 * static_cast<Eigen::Index>(order[j]);
    joint.landmarks.push_back(inactive_->settledLandmarks()[order[j]]);
    C.block<3, kLandmarks>(offsetOf(j), 0) = cross.block<kLandmarks, 3>(0, from).transpose();
    for (std::size_t i = j; i < inactive; ++i)
      C.block<3, 3>(offsetOf(i), offsetOf(j)) =
          inactive_->settledCovariance().block<3, 3>(3 * static_cast<Eigen::Index>(order[i]), from);
    for (std::size_t i = 0; i < active.size(); ++i)
      C.block<3, 3>(offsetOf(inactive + i), offsetOf(j)) = cross.block<3, 3>(offsetOf(active[i]), from);
  }
  for (std::size_t j = 0; j < active.size(); ++j) {
    const Eigen::Index to = offsetOf(inactive + j), from = offsetOf(active[j]);
    joint.landmarks.push_back(landmarks_[active[j]]);
    C.block<3, kLandmarks>(to, 0) = P.block<3, kLandmarks>(from, 0);
    for (std::size_t i = j; i < active.size(); ++i)
      C.block<3, 3>(offsetOf(inactive + i), to) = P.block<3, 3>(offsetOf(active[i]), from);
  }
  mirrorLower(C);
  return joint;
}

void State::restore(const SE3& pose, const Vector6d& twist, const Vector6d& bias, Joint joint) {
  pose_ = pose.normalized();
  twist_ = twist;
  bias_ = bias;
  landmarks_.clear();
  const Eigen::Index k3 = joint.covariance.rows() - kLandmarks;
  // xi_p = dp + [p]x xi_R.
  const Eigen::Matrix3d M = so3::hat(pose_.translation());
  joint.covariance.middleRows<3>(kPosition) += (M * joint.covariance.middleRows<3>(kRotation)).eval();
  joint.covariance.middleCols<3>(kPosition) -=
      (joint.covariance.middleCols<3>(kRotation) * M).eval(); // [p]x^T = -[p]x
  covariance_.topLeftCorner<kLandmarks, kLandmarks>() =
      joint.covariance.topLeftCorner<kLandmarks, kLandmarks>();
  mirrorLower(covariance_.topLeftCorner<kLandmarks, kLandmarks>());
  for (Landmark& landmark : joint.landmarks) landmark.anchored = false;
  inactive_->adopt(std::move(joint.landmarks), joint.covariance.bottomRightCorner(k3, k3),
                   joint.covariance.topRightCorner(kLandmarks, k3));
}

void State::adopt(std::vector<Landmark> landmarks, Eigen::MatrixXd covariance) {
  Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(size(), covariance.cols());
  inactive_->adopt(std::move(landmarks), std::move(covariance), std::move(cross));
}

/// T Exp(xi) T^-1 = Exp(Ad(T) xi). For a landmark T m = R Exp(xi_R) (m^ + e) + t = Exp(R xi_R) (R m^ + t +
/// e') with e' = R e + [t]x R xi_R to first order.
void State::moveWorld(const SE3& to_T_world) {
  if (inactive_ && inactive_->size() > 0)
    throw std::logic_error("inactive landmarks do not move with the world");
  if (inactive_) inactive_->adopt({}, Eigen::MatrixXd(0, 0), Eigen::MatrixXd(size(), 0)); // nor the journal
  const Eigen::Matrix3d& R = to_T_world.rotation();
  const Eigen::Matrix3d shift = so3::hat(to_T_world.translation()) * R;
  onBothSides(covariance_.topLeftCorner(size(), size()), [&](Eigen::Ref<Eigen::MatrixXd>& rows) {
    const Eigen::Matrix<double, 3, Eigen::Dynamic> rotation = rows.middleRows<3>(kRotation);
    rows.middleRows<3>(kPosition) = (R * rows.middleRows<3>(kPosition) + shift * rotation).eval();
    rows.middleRows<3>(kRotation) = R * rotation;
    for (std::size_t i = 0; i < landmarks_.size(); ++i) {
      auto own = rows.middleRows<3>(offsetOf(i));
      own = (R * own + shift * rotation).eval();
    }
  });
  pose_ = (to_T_world * pose_).normalized();
  for (Landmark& landmark : landmarks_) landmark.position = to_T_world * landmark.position;
}

} // namespace vi_ekf_slam::invariant
