#include "vi_ekf_slam/core/filter/filter.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <optional>
#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/core/filter/direct_update.hpp"
#include "vi_ekf_slam/core/filter/symmetric.hpp"
#include "vi_ekf_slam/core/filter/triangular.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

constexpr Eigen::Index kRoom = 304; // rows to begin with; of eights, for vector instructions
constexpr double kLargeTurn = 0.02; // rad, whose half square is 2 cm in 100 m: what first order misses

/// (dp, theta) once the body is elsewhere and the error, as of the group, is the same: dp' = dp - [moved]x
/// theta.
template <class Matrix>
void transportRows(Matrix&& X, const Eigen::Vector3d& moved) {
  X.template topRows<3>().noalias() -= so3::hat(moved) * X.template middleRows<3>(3);
}
void transport(Eigen::Ref<Eigen::MatrixXd> P, const Eigen::Vector3d& moved) {
  transportRows(P, moved);
  P.leftCols<3>().noalias() += P.middleCols<3>(3) * so3::hat(moved);
}

} // namespace

Eigen::Matrix<double, 3, 6> byPose(const Eigen::Vector3d& point, const Eigen::Vector3d& position) {
  return -se3::pointJacobian(point - position);
}

Filter::Filter(const SE3& pose, const Matrix6d& covariance)
    : variables_(pose), covariance_(Eigen::MatrixXd::Zero(kRoom, kRoom)) {
  covariance_.topLeftCorner<6, 6>() = covariance;
}

void Filter::closeCore() {
  if (rows() > kMostCoreRows) throw std::logic_error("the core has more rows than its steps have room for");
  core_rows_ = rows();
  core_ = CompressedCore(core_rows_);
}

Eigen::MatrixXd Filter::covariance(Handle a, Handle b) const {
  return covariance_.block(rowOf(a), rowOf(b), variables_.sizeOf(a), variables_.sizeOf(b));
}

Eigen::Matrix3d Filter::worldCovariance(Handle point) const {
  const Eigen::Matrix<double, 3, 6> J = -byPose(variables_.point(point), pose().translation());
  const Eigen::Index row = rowOf(point);
  const Eigen::Matrix3d cross = J * covariance_.block<6, 3>(0, row);
  const Eigen::Matrix3d sum = covariance_.block<3, 3>(row, row) + cross + cross.transpose() +
                              J * covariance_.topLeftCorner<6, 6>() * J.transpose();
  return sum.selfadjointView<Eigen::Lower>();
}

/// byPose of all points, row by row; 0 for what is not one.
Eigen::MatrixXd Filter::poseInfluence(const Eigen::Vector3d& position) const {
  Eigen::MatrixXd X = Eigen::MatrixXd::Zero(rows(), 6);
  for (const Handle handle : variables_.handles()) {
    if (variables_.chartOf(handle) == Chart::kPoint)
      X.middleRows<3>(rowOf(handle)) = byPose(variables_.point(handle), position);
  }
  return X;
}

/// Of P: F P F^T + Q of the core; its covariance with the rest waits.
void Filter::propagate(const CoreStep& step) {
  const Eigen::Index k = step.F.rows(), w = step.F.cols(), q = step.Q.rows();
  auto Pc = covariance_.topLeftCorner(core_rows_, core_rows_);
  core_.open(pose().translation(), Pc);
  auto padded = paddedCore();
  const Eigen::Index behind = padded.rows() - core_rows_;
  const auto move = [&](const auto& F) {
    CoreSquare PF = padded.middleCols(step.row, w).lazyProduct(F.transpose());
    PF.bottomRows(behind) = padded.middleCols(step.row, k).bottomRows(behind);
    const CoreSquare FPF = F.lazyProduct(PF.middleRows(step.row, w));
    padded.middleCols(step.row, k) = PF;
    Pc.middleRows(step.row, k) = PF.topRows(core_rows_).transpose();
    Pc.block(step.row, step.row, k, k) = 0.5 * (FPF + FPF.transpose());
    core_.transform(step.row, F);
  };
  if (k == 6 && w == 12)
    move(Eigen::Matrix<double, 6, 12>(step.F)); // a pose by its twist, with each sample
  else
    move(step.F);
  Pc.block(step.row, step.row, q, q) += step.Q;
  variables_.setPose(step.pose);
  for (const auto& [handle, mean] : step.means) variables_.mean(handle) = mean;
}

void Filter::settle() {
  if (core_.isOpen()) endPeriod(Eigen::MatrixXd(rows() - core_rows_, 0), 0);
}

void Filter::moveRest(Handle by, const Eigen::MatrixXd& G) {
  if (!core_.isOpen()) core_.open(pose().translation(), covariance_.topLeftCorner(core_rows_, core_rows_));
  endPeriod(G, by);
}

/// The rest r keeps its world form d, y = d + X x_pose, with X0 and X1 = X0 M where the period began and
/// ends, and moves by G x_by then: P_yy' = P_yy + X0 W^T + W X0^T - A Gamma Gamma^T A^T + G Z^T + Z G^T, with
/// A = P_d0 and Z = P_y,by + G P_by,by / 2.
void Filter::endPeriod(const Eigen::MatrixXd& G, Handle by) {
  core_.close();
  const Eigen::Index c = core_rows_, n = rows(), r = n - c;
  const Eigen::MatrixXd Gamma = core_.Gamma();
  inactive_.learn(Gamma, core_.psi());
  if (r == 0) {
    inactive_.transform([&](auto X) { X = (core_.Phi() * X).eval(); });
    return;
  }
  const Eigen::Vector3d moved = pose().translation() - core_.position();
  Matrix6d M = Matrix6d::Identity();
  M.topRightCorner<3, 3>() = so3::hat(moved);
  const Eigen::MatrixXd X0 = poseInfluence(core_.position()).bottomRows(r);
  // P_rc and P_c0 are as of the beginning, P_cc is of now.
  const Eigen::MatrixXd Phi = core_.Phi();
  const Eigen::MatrixXd& P_c0 = core_.covariance();
  const auto P_cc = covariance_.topLeftCorner(c, c);
  auto P_rc = covariance_.block(c, 0, r, c);
  const Eigen::MatrixXd C0 = P_rc.leftCols<6>();
  Eigen::MatrixXd A = P_rc;
  A.noalias() -= X0 * P_c0.topRows<6>();
  const Matrix6d T0 = P_c0.topLeftCorner<6, 6>(), T1 = P_cc.topLeftCorner<6, 6>();
  const Eigen::MatrixXd learned = A * Gamma;
  P_rc.noalias() = A * Phi.transpose();
  const Eigen::Index q = Gamma.cols(), k = G.cols(), row = k > 0 ? rowOf(by) : 0;
  Eigen::MatrixXd left(r, 12 + q + 2 * k), right(r, 12 + q + 2 * k);
  left.leftCols<6>() = right.middleCols<6>(6) = X0;
  left.middleCols<6>(6) = P_rc.leftCols<6>() * M.transpose() - C0;
  left.middleCols<6>(6).noalias() += X0 * (0.5 * (T0 + M * T1 * M.transpose()));
  right.leftCols<6>() = left.middleCols<6>(6);
  left.middleCols(12, q) = -learned;
  right.middleCols(12, q) = learned;
  P_rc.noalias() += X0 * (M * P_cc.topRows<6>());
  if (k > 0) {
    left.middleCols(12 + q, k) = right.rightCols(k) = G;
    left.rightCols(k) = P_rc.middleCols(row, k);
    left.rightCols(k).noalias() += G * (0.5 * P_cc.block(row, row, k, k));
    right.middleCols(12 + q, k) = left.rightCols(k);
    P_rc.noalias() += G * P_cc.middleRows(row, k);
  }
  auto P_rr = covariance_.block(c, c, r, r);
  P_rr.triangularView<Eigen::Lower>() += left * right.transpose();
  mirrorLower(P_rr);
  covariance_.block(0, c, c, r) = P_rc.transpose();
  Eigen::VectorXd correction = A * core_.psi();
  if (k > 0) correction += G * variables_.mean(by);
  for (const Handle handle : variables_.handles()) {
    const Eigen::Index at = rowOf(handle);
    if (at >= c) variables_.mean(handle) += correction.segment(at - c, variables_.sizeOf(handle));
  }
  inactive_.transform([&](auto X) {
    const Eigen::MatrixXd before = X.topRows(c);
    X.topRows(c).noalias() = Phi * before;
    auto rest = X.bottomRows(r);
    rest.noalias() += X0 * (M * X.template topRows<6>() - before.topRows<6>());
    rest.noalias() -= learned * (Gamma.transpose() * before);
    if (k > 0) rest.noalias() += G * X.middleRows(row, k);
  });
}

void Filter::addNoise(Eigen::Index row, const Eigen::Ref<const Eigen::MatrixXd>& noise) {
  settle();
  covariance_.block(row, row, noise.rows(), noise.cols()) += noise;
}

void Filter::reserve(Eigen::Index rows) {
  if (rows <= covariance_.rows()) return;
  const Eigen::Index used = this->rows();
  const Eigen::Index room = (2 * rows + 7) / 8 * 8;
  Eigen::MatrixXd larger(room, room);
  larger.topLeftCorner(used, used) = P();
  covariance_.swap(larger);
}

Handle Filter::augment(Chart chart, const Eigen::VectorXd& mean,
                       const Eigen::Ref<const Eigen::MatrixXd>& noise, const LinearFunction& by,
                       const std::string& name) {
  settle();
  const Eigen::Index n = rows(), k = mean.size();
  reserve(n + k);
  auto cross = covariance_.block(n, 0, k, n);
  auto own = covariance_.block(n, n, k, k);
  cross.setZero();
  if (!by.isNone()) cross.noalias() = by.J * covariance_.block(by.row, 0, by.J.cols(), n);
  own = noise;
  if (!by.isNone()) own += cross.middleCols(by.row, by.J.cols()) * by.J.transpose();
  covariance_.block(0, n, n, k) = cross.transpose();
  inactive_.append(k, by);
  return variables_.add(chart, mean, name);
}

bool Filter::correct(const LinearMeasurement& z) {
  if (z.isWithin(core_rows_)) // three rows, as most have, are for the compiler to know
    return z.rows() == 3 ? correctCore<3>(z) : correctCore<Eigen::Dynamic>(z);
  settle();
  Innovation in(covariance(), {z});
  return in.factorise() && correct(in);
}

template <int kRows>
bool Filter::correctCore(const LinearMeasurement& z) {
  constexpr int kMostRows = kRows == Eigen::Dynamic ? 6 : kRows;
  using Square = Eigen::Matrix<double, kRows, kRows, Eigen::ColMajor, kMostRows, kMostRows>;
  using Vector = Eigen::Matrix<double, kRows, 1, Eigen::ColMajor, kMostRows, 1>;
  const Eigen::Index c = core_rows_;
  auto Pc = covariance_.topLeftCorner(c, c);
  auto padded = paddedCore();
  CoreColumns<kRows> PHt = CoreColumns<kRows>::Zero(padded.rows(), z.rows());
  z.addTransposedProduct(padded, PHt);
  PHt.bottomRows(padded.rows() - c).setZero();
  Square S = z.noise();
  z.addProduct(PHt, S);
  const Eigen::LLT<Square> llt(S);
  if (llt.info() != Eigen::Success) return false;
  const Square L_inverse = llt.matrixL().solve(Square::Identity(z.rows(), z.rows()));
  const Vector white = L_inverse.lazyProduct(z.residual());
  const CoreColumns<kRows> A = PHt.lazyProduct(L_inverse.transpose());
  const CoreVector error = A.topRows(c).lazyProduct(white);
  if (!error.allFinite()) return false;
  core_.open(pose().translation(), Pc);
  core_.correct(z, L_inverse, white, A);
  padded.noalias() -= A.lazyProduct(A.topRows(c).transpose());
  const Eigen::Vector3d before = pose().translation();
  const auto reexpressed = variables_.retract(error, c, {});
  reexpress(Pc, reexpressed);
  reexpressRows(core_.Phi(), reexpressed);
  const Eigen::Vector3d moved = pose().translation() - before;
  transport(Pc, moved);
  transportRows(core_.Phi(), moved);
  return true;
}

/// P - K S K^T = P - A A^T with A = P H^T L^-T, symmetric by construction.
bool Filter::correct(const Innovation& in, const PointChart& chart) {
  const bool turns = !inactive_.isEmpty() && in.error().segment<3>(3).norm() > kLargeTurn;
  const std::vector<InactiveStore::Estimate> inactive_before =
      turns ? inactive_.estimates(false) : std::vector<InactiveStore::Estimate>();
  const std::optional<DirectUpdate> direct = DirectUpdate::make(in);
  Eigen::MatrixXd root;
  if (direct) {
    if (!direct->isFinite()) return false;
  } else {
    root = in.PHt();
    divideByLowerTransposed(root, in.L());
    if (!root.allFinite()) return false;
  }
  const Eigen::Vector3d before = pose().translation();
  const std::vector<Variables::Reexpressed> points = variables_.retract(in.error(), rows(), chart);
  if (direct) {
    direct->correct(P(), points);
  } else {
    subtractSquare(P(), root);
    reexpress(P(), points);
  }
  inactive_.correct(in, direct ? &*direct : nullptr, root, points);
  const Eigen::Vector3d moved = pose().translation() - before;
  transport(P(), moved);
  inactive_.transform([&moved](auto X) { transportRows(X, moved); });
  if (turns) moveInactive(inactive_before);
  return true;
}

void Filter::remove(Handle handle) {
  settle();
  const Eigen::Index n = rows();
  erase(variables_.remove(handle), n);
}

void Filter::erase(const Variables::Gone& gone, Eigen::Index rows_before) {
  auto all = covariance_.topLeftCorner(rows_before, rows_before);
  eraseRows(all, gone, rows_before);
  eraseRows(all.transpose(), gone, rows_before);
  inactive_.erase(gone);
}

} // namespace vi_ekf_slam
