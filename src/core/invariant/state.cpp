#include "vi_ekf_slam/core/invariant/state.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/invariant/columns3.hpp"
#include "vi_ekf_slam/core/invariant/inverse_depth.hpp"
#include "vi_ekf_slam/core/invariant/symmetric.hpp"
#include "vi_ekf_slam/core/invariant/triangular.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using Rows3 = Pooled<Eigen::Matrix<double, 3, Eigen::Dynamic>>;

// S over R, up to which S^-1 is had from K: rounding grows by as much.
constexpr double kMostLearned = 1e4;

} // namespace

State::State(const Prior& prior, bool keeps_inactive, std::size_t deferred_bytes)
    : covariance_(PooledMatrix::Zero(kLandmarks + 300, kLandmarks + 300)) {
  if (keeps_inactive) inactive_.emplace(deferred_bytes);
  auto variances = covariance_.diagonal();
  variances.segment<6>(kPosition) = prior.pose_sigma.cwiseAbs2();
  variances.segment<6>(kTwist) = prior.twist_sigma.cwiseAbs2();
  variances.segment<6>(kBias) = prior.bias_sigma.cwiseAbs2();
}

/// How a constant error dnu of the twist over the last or next dt s moves the errors: (xi, e) += G dnu with
/// G = [B; [m]x B_R], B = dt Ad(T) J_l(dt nu) at the step's start, B_R what dnu does to xi_R.
State::Columns6 State::twistInfluence(double dt, const SE3& start) const {
  const Matrix6d B = dt * start.adjoint() * se3::leftJacobian(dt * twist_);
  Columns6 G = Columns6::Zero(size(), 6);
  G.topRows<6>() = B;
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    G.middleRows<3>(offsetOf(i)).noalias() = so3::hat(landmarks_[i].position) * B.bottomRows<3>();
  }
  return G;
}

void State::propagate(double dt, const ProcessNoise& noise) {
  Columns6 G = twistInfluence(dt, pose_);
  auto P = covariance_.topLeftCorner(size(), size());
  const Matrix6d twist_covariance = P.block<6, 6>(kTwist, kTwist);
  addTwistNoise(G, dt, noise, P.middleCols<6>(kTwist), twist_covariance);
  pose_ = (pose_ * SE3::Exp(dt * twist_)).normalized();
  record(Propagation{std::move(G)});
}

void State::record(DeferredStep step) {
  if (inactive_) inactive_->record(std::move(step), size());
}

void State::disturb(double dt, const ProcessNoise& noise) {
  const Columns6 G = twistInfluence(dt, pose_ * SE3::Exp(-dt * twist_));
  addTwistNoise(G, dt, noise, Columns6::Zero(size(), 6), Matrix6d::Zero());
}

/// The error Log(T T^^-1) is that of before, since truth and estimate move by the same T <- T motion. What is
/// added: with dp = xi_p - [p]x xi_R, and d = e - [m]x xi_R = 0 for landmarks, (xi_p, xi_R, e) = ([I, [p]x],
/// [0, I], [0, [m]x]) (dp, dtheta).
void State::displace(const SE3& motion, const Matrix6d& covariance) {
  pose_ = (pose_ * motion).normalized();
  Columns6 G = Columns6::Zero(size(), 6);
  G.topRows<6>().setIdentity();
  G.block<3, 3>(kPosition, 3) = so3::hat(pose_.translation());
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    G.block<3, 3>(offsetOf(i), 3) = so3::hat(landmarks_[i].position);
  }
  addSquare(G, covariance);
}

/// P += [G cov(dnu) G^T and its cross terms] for a twist error that is `cross` (all errors with dnu) and
/// `twist_covariance` at the step's start, and driven by white noise of its derivative during it: Q dt on nu,
/// Q dt / 3 on the step's mean twist, Q dt / 2 between the two.
void State::addTwistNoise(const Columns6& G, double dt, const ProcessNoise& noise,
                          const Columns6& cross_start, const Matrix6d& twist_covariance) {
  const Vector6d Q = dt * noise.twist_density.cwiseAbs2();
  auto P = covariance_.topLeftCorner(size(), size());
  Matrix6d mean_covariance = twist_covariance;
  mean_covariance.diagonal() += Q / 3.0;
  Pooled<Eigen::Matrix<double, Eigen::Dynamic, 12>> left(size(), 12), right(size(), 12);
  left.leftCols<6>() = right.rightCols<6>() = G;
  left.rightCols<6>() = cross_start;
  left.rightCols<6>().noalias() += G * (0.5 * mean_covariance);
  right.leftCols<6>() = left.rightCols<6>();
  P.noalias() += left * right.transpose();
  const Columns6 cross = G * (0.5 * Q).asDiagonal();
  P.middleCols<6>(kTwist) += cross;
  P.middleRows<6>(kTwist) += cross.transpose();
  P.diagonal().segment<6>(kTwist) += Q;
  P.diagonal().segment<6>(kBias) += dt * noise.bias_density.cwiseAbs2();
}

Correction::Correction(PooledMatrix PHt, PooledMatrix S, Pooled<Eigen::VectorXd> innovation, SparseRows H,
                       const std::optional<Eigen::Matrix3d>& noise)
    : PHt_(std::move(PHt)), L_(std::move(S)), H_(std::move(H)), weighted_(std::move(innovation)) {
  if (noise && L_.diagonal().maxCoeff() < kMostLearned * noise->diagonal().minCoeff()) noise_ = noise;
  if (Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>>(L_).info() != Eigen::Success) return; // in its place
  L_.triangularView<Eigen::Lower>().solveInPlace(weighted_);
  nis_ = weighted_.squaredNorm();
  L_.transpose().triangularView<Eigen::Upper>().solveInPlace(weighted_);
  error_ = PHt_ * weighted_;
  valid_ = nis_ >= 0.0 && error_.allFinite();
}

std::optional<RelativeUpdate> Correction::relative() const {
  return noise_ ? RelativeUpdate::make(H_, *noise_, PHt_, L_) : std::nullopt;
}

/// `Kt` is K^T.
KalmanUpdate Correction::takeUpdate(PooledMatrix Kt) {
  if (noise_) return {std::move(Kt), std::move(H_), std::move(weighted_), PooledMatrix(), noise_->inverse()};
  invertLower(L_);
  squareLower(L_);
  mirrorLower(L_);
  return {std::move(Kt), std::move(H_), std::move(weighted_), std::move(L_), Eigen::Matrix3d::Zero()};
}

/// P - K H P = P - A A^T with A = P H^T L^-T, symmetric by construction, and K = A L^-1, which moves what is
/// correlated with the errors just as that moves the errors; P^+ H^T R^-1, which would be cheaper, does not
/// to the last digits.
bool State::apply(Correction correction, const SE3* cam_T_imu) {
  if (!correction.isValid()) return false;
  PooledMatrix& A = correction.PHt_;
  if (inactive_ && correction.H_.rows() != A.cols())
    throw std::logic_error("a state that keeps inactive landmarks needs the measurement matrix");
  auto P = covariance_.topLeftCorner(size(), size());
  if (auto relative = correction.relative()) {
    if (!relative->isFinite()) return false;
    if (inactive_) record(correction.takeUpdate(relative->transposedGain()));
    PooledVector<Eigen::Matrix3d> M = retract(correction.error_, cam_T_imu);
    relative->correct(P, M);
    if (!M.empty()) record(Transport{std::move(M)});
    return true;
  }
  divideByLowerTransposed(A, correction.L_);
  if (!A.allFinite()) return false;
  subtractSquare(P, A);
  if (inactive_) {
    divideByLower(A, correction.L_);
    record(correction.takeUpdate(A.transpose()));
  }
  PooledVector<Eigen::Matrix3d> M = retract(correction.error_, cam_T_imu);
  if (!M.empty()) {
    transport(M);
    record(Transport{std::move(M)});
  }
  return true;
}

/// Moves the mean by the error. What was learned is mostly recent (this step's motion, a landmark's depth),
/// so the world-axes form of the error is small and is what moves pose and landmarks: dp = xi_p + xi_R x p,
/// d = e + xi_R x m. Rotating everything about the world's far origin instead, as the group's own retraction
/// does, is the same to first order, but leaves second-order errors that all have one sign and grow with the
/// distance driven.
///
/// A landmark before the camera is moved in (x/z, y/z, 1/z) of the camera, where pixels are linear, and its
/// error is re-expressed at the new point so that its covariance in those coordinates is unchanged: with
/// straight coordinates the noise of far points' depth turns into a bias of scale.
/// Returns, landmark by landmark, M of that re-expression (see transport); nothing without `cam_T_imu`.
PooledVector<Eigen::Matrix3d> State::retract(const Pooled<Eigen::VectorXd>& error, const SE3* cam_T_imu) {
  const Eigen::Vector3d xi_p = error.segment<3>(kPosition), xi_R = error.segment<3>(kRotation);
  pose_ = SE3(so3::Exp(xi_R) * pose_.rotation(), pose_.translation() + xi_p + xi_R.cross(pose_.translation()))
              .normalized();
  twist_ += error.segment<6>(kTwist);
  bias_ += error.segment<6>(kBias);
  const SE3 cam_T_world = cam_T_imu ? *cam_T_imu * pose_.inverse() : SE3();
  const SE3 world_T_cam = cam_T_world.inverse();
  PooledVector<Eigen::Matrix3d> M(cam_T_imu ? landmarks_.size() : 0, Eigen::Matrix3d::Identity());
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    Eigen::Vector3d& m = landmarks_[i].position;
    const Eigen::Vector3d d = error.segment<3>(offsetOf(i)) + xi_R.cross(m);
    const Eigen::Vector3d q = cam_T_world * m;
    if (!cam_T_imu || !InverseDepth::isDefined(q)) {
      m += d;
      continue;
    }
    const Eigen::Matrix3d& R = cam_T_world.rotation();
    const Eigen::Vector3d moved = InverseDepth::moved(q, R * d);
    m = world_T_cam * moved;
    M[i] = R.transpose() * InverseDepth::pointJacobian(moved) * InverseDepth::jacobian(q) * R;
  }
  return M;
}

/// Re-expresses the landmarks' errors relative to the body: (e_j - xi_p) <- M_j (e_j - xi_p). P <- T P T^T,
/// column by column and then row by row, of the lower triangle.
void State::transport(const PooledVector<Eigen::Matrix3d>& M) {
  auto P = covariance_.topLeftCorner(size(), size());
  Rows3 position = P.middleCols<3>(kPosition).transpose(); // the body's rows of P T^T
  const Eigen::Matrix3d base = position.middleCols<3>(kPosition);
  for (std::size_t j = 0; j < M.size(); ++j) {
    const Eigen::Index column = offsetOf(j), below = size() - column;
    auto own = P.middleCols<3>(column).bottomRows(below);
    turnAbout(P.middleCols<3>(kPosition).bottomRows(below), own, M[j].transpose(), own);
    position.middleCols<3>(column) = base + (position.middleCols<3>(column) - base) * M[j].transpose();
  }
  for (Eigen::Index column = 0; column < size(); column += 3) {
    const Eigen::Matrix3d body = position.middleCols<3>(column);
    const Eigen::Index first = std::max<Eigen::Index>(column - kLandmarks, 0) / 3;
    for (auto i = static_cast<std::size_t>(first); i < M.size(); ++i) {
      auto block = P.block<3, 3>(offsetOf(i), column);
      const Eigen::Matrix3d way = block - body;
      block = body + M[i] * way;
    }
  }
  mirrorLower(P);
}

void State::reserve(Eigen::Index size) {
  if (size <= covariance_.rows()) return;
  const Eigen::Index used = this->size();
  PooledMatrix larger(2 * size, 2 * size);
  larger.topLeftCorner(used, used) = covariance_.topLeftCorner(used, used);
  covariance_.swap(larger);
}

void State::addLandmark(FeatureId id, const Eigen::Vector3d& position, const Eigen::Matrix3d& noise) {
  const Eigen::Index n = size();
  reserve(n + 3);
  covariance_.block(n, 0, 3, n) = covariance_.block(kPosition, 0, 3, n);
  covariance_.block(0, n, n, 3) = covariance_.block(0, kPosition, n, 3);
  covariance_.block<3, 3>(n, n) = covariance_.block<3, 3>(kPosition, kPosition) + noise;
  landmarks_.push_back({id, position});
  record(Birth{});
}

void State::removeLandmark(std::size_t index) {
  dropLandmark(index);
  record(Removal{offsetOf(index)});
}

void State::dropLandmark(std::size_t index) {
  const Eigen::Index n = size(), last = n - 3, gone = offsetOf(index);
  if (gone != last) {
    const Rows3 rows = covariance_.block(last, 0, 3, n);
    const Eigen::Matrix3d own = rows.middleCols<3>(last);
    covariance_.block(gone, 0, 3, n) = rows;
    covariance_.block(0, gone, n, 3) = rows.transpose();
    covariance_.block<3, 3>(gone, gone) = own;
    landmarks_[index] = landmarks_.back();
  }
  landmarks_.pop_back();
}

PooledHashMap<FeatureId, std::size_t> State::indexById() const {
  PooledHashMap<FeatureId, std::size_t> index(landmarks_.size());
  for (std::size_t i = 0; i < landmarks_.size(); ++i) index.emplace(landmarks_[i].id, i);
  return index;
}

void State::forget(Eigen::Index row, const Eigen::Vector3d& sigma) {
  covariance_.block(row, 0, 3, size()).setZero();
  covariance_.block(0, row, size(), 3).setZero();
  covariance_.diagonal().segment<3>(row) = sigma.cwiseAbs2();
  record(Oblivion{row});
}

void State::loosen(const Matrix6d& noise) {
  Columns6 G = Columns6::Zero(size(), 6);
  G.topRows<6>().setIdentity();
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    auto rows = G.middleRows<3>(offsetOf(i));
    if (landmarks_[i].anchored)
      rows.rightCols<3>() = so3::hat(landmarks_[i].position); // its d = e - [m]x xi_R stays
    else
      rows.leftCols<3>().setIdentity();
  }
  addSquare(G, noise);
}

/// P += G noise G^T.
void State::addSquare(const Columns6& G, const Matrix6d& noise) {
  const Columns6 moved = G * noise;
  auto P = covariance_.topLeftCorner(size(), size());
  P.noalias() += moved * G.transpose();
  mirrorLower(P);
}

Matrix6d alongWorldAxes(const Matrix6d& covariance, const Eigen::Vector3d& position) {
  Matrix6d J = Matrix6d::Identity();
  J.topRightCorner<3, 3>() = -so3::hat(position);
  return J * covariance * J.transpose();
}

Matrix6d State::poseCovariance() const {
  return alongWorldAxes(covariance_.topLeftCorner<6, 6>(), pose_.translation());
}

Eigen::Matrix3d State::relativeCovariance(Eigen::Index row) const {
  const Eigen::Matrix3d cross = covariance_.block<3, 3>(row, kPosition);
  return covariance_.block<3, 3>(row, row) + covariance_.block<3, 3>(kPosition, kPosition) - cross -
         cross.transpose();
}

Eigen::Matrix3d State::landmarkCovariance(std::size_t index) const {
  const Eigen::Index j = offsetOf(index);
  const Eigen::Matrix3d M = so3::hat(landmarks_[index].position);
  const Eigen::Matrix3d cross = M * covariance_.block<3, 3>(kRotation, j);
  const Eigen::Matrix3d rotation = M * covariance_.block<3, 3>(kRotation, kRotation) * M.transpose();
  return covariance_.block<3, 3>(j, j) + rotation - cross - cross.transpose();
}

} // namespace vi_ekf_slam::invariant
