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

BackwardSweep::BackwardSweep(Eigen::Index size, Eigen::Index capacity, bool with_information)
    : size_(size),
      with_information_(with_information),
      rows_(0, capacity),
      correction_(Eigen::VectorXd::Zero(capacity)) {
  if (with_information) information_ = Eigen::MatrixXd::Zero(capacity, capacity);
}

void BackwardSweep::startRows() {
  row_count_ = 0;
  appendRows(Eigen::MatrixXd::Identity(size_, size_));
}

void BackwardSweep::appendRows(const Eigen::MatrixXd& rows) {
  const Eigen::Index needed = row_count_ + rows.rows();
  if (needed > rows_.rows()) rows_.conservativeResize(2 * needed, Eigen::NoChange);
  rows_.block(row_count_, 0, rows.rows(), size_) = rows;
  row_count_ = needed;
}

void BackwardSweep::back(const DeferredStep& step) {
  std::visit([this](const auto& s) { back(s); }, step);
}

// x' = F x: rows <- rows F, information <- F^T information F, correction <- F^T correction.

void BackwardSweep::back(const Propagation& step) {
  auto rows = activeRows();
  rows.middleCols<6>(kTwist) += (rows * step.G).eval();
  correction_.segment<6>(kTwist) += (step.G.transpose() * correction()).eval();
  if (!with_information_) return;
  auto information = activeInformation();
  information.middleCols<6>(kTwist) += (information * step.G).eval();
  information.middleRows<6>(kTwist) += (step.G.transpose() * information).eval();
}

/// F = I - A B with B = L^-1 H; and B x is measured with unit noise: information += B^T B, correction += B^T w.
void BackwardSweep::back(const KalmanUpdate& step) {
  const auto L = step.L.triangularView<Eigen::Lower>();
  auto rows = activeRows();
  if (rows.rows() > 0) {
    Eigen::MatrixXd along = rows * step.A;
    L.solveInPlace<Eigen::OnTheRight>(along);
    step.H.subtractFrom(rows, along);
  }
  Eigen::VectorXd weighted = step.w - step.A.transpose() * correction();
  L.transpose().solveInPlace(weighted);
  step.H.addTransposed(correction_.head(size_), weighted);
  if (!with_information_) return;
  // F^T N F + B^T B = N - V H - H^T V^T with V = (N A - B^T (A^T N A + I) / 2) L^-1.
  auto information = activeInformation();
  Eigen::MatrixXd V = information * step.A;
  Eigen::MatrixXd T = step.A.transpose() * V;
  T.diagonal().array() += 1.0;
  L.transpose().solveInPlace(T);
  T *= -0.5;
  step.H.addTransposed(V, T);
  L.solveInPlace<Eigen::OnTheRight>(V);
  Eigen::MatrixXd minus_VH = Eigen::MatrixXd::Zero(size_, size_);
  step.H.subtractFrom(minus_VH, V);
  information += minus_VH;
  information += minus_VH.transpose();
}

void BackwardSweep::back(const Transport& step) {
  auto rows = activeRows();
  auto information = activeInformation();
  const auto move = [](auto&& f, Eigen::Index j, const Eigen::Matrix3d& M) {
    // f . x' = f_p x_p + f_j (x_p + M (x_j - x_p))
    const auto moved = (f.template middleCols<3>(j) * M).eval();
    f.template middleCols<3>(kPosition) += f.template middleCols<3>(j) - moved;
    f.template middleCols<3>(j) = moved;
  };
  for (std::size_t i = 0; i < step.M.size(); ++i) {
    const Eigen::Index j = State::offsetOf(i);
    if (rows.rows() > 0) move(rows, j, step.M[i]);
    const Eigen::Vector3d moved = step.M[i].transpose() * correction_.segment<3>(j);
    correction_.segment<3>(kPosition) += correction_.segment<3>(j) - moved;
    correction_.segment<3>(j) = moved;
    if (with_information_) move(information, j, step.M[i]);
  }
  if (!with_information_) return;
  information = information.transpose().eval();
  for (std::size_t i = 0; i < step.M.size(); ++i) move(information, State::offsetOf(i), step.M[i]);
}

void BackwardSweep::back(const Birth&) {
  const Eigen::Index n = size_ - 3;
  auto rows = activeRows();
  rows.middleCols<3>(kPosition) += rows.middleCols<3>(n);
  correction_.segment<3>(kPosition) += correction_.segment<3>(n);
  if (with_information_) {
    auto information = activeInformation();
    information.middleCols<3>(kPosition) += information.middleCols<3>(n);
    information.middleRows<3>(kPosition) += information.middleRows<3>(n);
  }
  size_ = n;
}

void BackwardSweep::back(const Removal& step) {
  const Eigen::Index n = size_, row = step.row;
  size_ = n + 3;
  auto rows = activeRows();
  rows.middleCols<3>(n).setZero();
  rows.middleCols<3>(row).swap(rows.middleCols<3>(n));
  correction_.segment<3>(n).setZero();
  correction_.segment<3>(row).swap(correction_.segment<3>(n));
  if (!with_information_) return;
  auto information = activeInformation();
  information.rightCols<3>().setZero();
  information.bottomRows<3>().setZero();
  information.middleCols<3>(row).swap(information.middleCols<3>(n));
  information.middleRows<3>(row).swap(information.middleRows<3>(n));
}

void BackwardSweep::back(const Oblivion& step) {
  activeRows().middleCols<3>(step.row).setZero();
  correction_.segment<3>(step.row).setZero();
  if (!with_information_) return;
  information_.middleCols<3>(step.row).setZero();
  information_.middleRows<3>(step.row).setZero();
}

} // namespace vi_ekf_slam::invariant
