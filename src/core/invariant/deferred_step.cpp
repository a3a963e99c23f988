#include "vi_ekf_slam/core/invariant/deferred_step.hpp"

#include "vi_ekf_slam/core/invariant/state.hpp"

namespace vi_ekf_slam::invariant {
namespace {

std::size_t bytes(const Eigen::MatrixXd& matrix) {
  return static_cast<std::size_t>(matrix.size()) * sizeof(double);
}

std::size_t heapOf(const Propagation& step) {
  return static_cast<std::size_t>(step.G.size()) * sizeof(double);
}
std::size_t heapOf(const KalmanUpdate& step) { return bytes(step.A) + bytes(step.L) + step.H.bytes(); }
std::size_t heapOf(const Transport& step) { return step.M.size() * sizeof(Eigen::Matrix3d); }
template <class Small>
std::size_t heapOf(const Small&) {
  return 0;
}

} // namespace

std::size_t bytesOf(const DeferredStep& step) {
  return sizeof(DeferredStep) + std::visit([](const auto& s) { return heapOf(s); }, step);
}

void CorrectionSweep::back(const DeferredStep& step) {
  std::visit([this](const auto& s) { back(s); }, step);
}

// x' = F x: correction <- F^T correction.

void CorrectionSweep::back(const Eigen::MatrixXd& F, const Eigen::VectorXd& learned) {
  correction_ = learned + F.transpose() * correction_;
}

void CorrectionSweep::back(const Propagation& step) {
  correction_.segment<6>(kTwist) += (step.G.transpose() * correction_).eval();
}

/// F = I - A B with B = L^-1 H; and B x is measured with unit noise: correction += B^T w.
void CorrectionSweep::back(const KalmanUpdate& step) {
  Eigen::VectorXd weighted = step.w - step.A.transpose() * correction_;
  step.L.triangularView<Eigen::Lower>().transpose().solveInPlace(weighted);
  step.H.addTransposed(correction_, weighted);
}

void CorrectionSweep::back(const Transport& step) {
  for (std::size_t i = 0; i < step.M.size(); ++i) {
    const Eigen::Index j = State::offsetOf(i);
    const Eigen::Vector3d moved = step.M[i].transpose() * correction_.segment<3>(j);
    correction_.segment<3>(kPosition) += correction_.segment<3>(j) - moved;
    correction_.segment<3>(j) = moved;
  }
}

void CorrectionSweep::back(const Birth&) {
  correction_.segment<3>(kPosition) += correction_.tail<3>();
  correction_.conservativeResize(correction_.size() - 3);
}

void CorrectionSweep::back(const Removal& step) {
  correction_.conservativeResize(correction_.size() + 3);
  correction_.tail<3>().setZero();
  correction_.segment<3>(step.row).swap(correction_.tail<3>());
}

void CorrectionSweep::back(const Oblivion& step) { correction_.segment<3>(step.row).setZero(); }

ForwardSweep::ForwardSweep(Eigen::Index size, Eigen::Index rows, Eigen::Index columns)
    : rows_(size),
      columns_(size),
      X_(size + rows, columns),
      gram_(Eigen::MatrixXd::Zero(size + rows, size + rows)),
      learned_(Eigen::VectorXd::Zero(size + rows)) {
  active().setIdentity();
}

void ForwardSweep::append(const Eigen::Matrix<double, 3, Eigen::Dynamic>& cross) {
  X_.block(rows_, 0, 3, columns_) = cross;
  rows_ += 3;
}

void ForwardSweep::forward(const DeferredStep& step) {
  std::visit([this](const auto& s) { forward(s); }, step);
}

void ForwardSweep::forward(const Propagation& step) {
  const Eigen::Matrix<double, Eigen::Dynamic, 6> twist = active().middleCols<6>(kTwist);
  active().noalias() += twist * step.G.transpose();
}

/// With Y = X B^T, B = L^-1 H: X -= Y A^T, and y is learned about by Y w, with Y Y^T less of its covariance.
void ForwardSweep::forward(const KalmanUpdate& step) {
  Eigen::MatrixXd Y = step.H.timesTransposed(active());
  step.L.triangularView<Eigen::Lower>().transpose().solveInPlace<Eigen::OnTheRight>(Y);
  active().noalias() -= Y * step.A.transpose();
  gram_.topLeftCorner(rows_, rows_).selfadjointView<Eigen::Lower>().rankUpdate(Y);
  learned_.head(rows_).noalias() += Y * step.w;
}

void ForwardSweep::forward(const Transport& step) {
  const Eigen::Matrix<double, Eigen::Dynamic, 3> position = active().middleCols<3>(kPosition);
  for (std::size_t i = 0; i < step.M.size(); ++i) {
    auto own = active().middleCols<3>(State::offsetOf(i));
    own = (position + (own - position) * step.M[i].transpose()).eval();
  }
}

void ForwardSweep::forward(const Birth&) {
  columns_ += 3;
  active().rightCols<3>() = active().middleCols<3>(kPosition);
}

void ForwardSweep::forward(const Removal& step) {
  if (step.row != columns_ - 3) active().middleCols<3>(step.row) = active().rightCols<3>().eval();
  columns_ -= 3;
}

void ForwardSweep::forward(const Oblivion& step) { active().middleCols<3>(step.row).setZero(); }

} // namespace vi_ekf_slam::invariant
