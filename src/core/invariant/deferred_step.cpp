#include "vi_ekf_slam/core/invariant/deferred_step.hpp"

#include "vi_ekf_slam/core/invariant/columns3.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/invariant/symmetric.hpp"

namespace vi_ekf_slam::invariant {
namespace {

template <class Matrix>
std::size_t bytes(const Matrix& matrix) {
  return static_cast<std::size_t>(matrix.size()) * sizeof(double);
}

std::size_t heapOf(const Propagation& step) {
  return static_cast<std::size_t>(step.G.size()) * sizeof(double);
}
std::size_t heapOf(const KalmanUpdate& step) {
  return bytes(*step.Kt) + bytes(step.S_inverse) + step.H.bytes();
}
std::size_t heapOf(const Transport& step) { return step.M.size() * sizeof(Eigen::Matrix3d); }
template <class Small>
std::size_t heapOf(const Small&) {
  return 0;
}

/// Z S^-1 for Z = X H^T and `after` = X (I - K H)^T.
PooledMatrix timesInverseS(const KalmanUpdate& step, const PooledMatrix& Z,
                           const Eigen::Ref<const Eigen::MatrixXd>& after) {
  if (step.S_inverse.size() > 0) return Z * step.S_inverse;
  PooledMatrix result = step.H.timesTransposed(after);
  for (Eigen::Index i = 0; i < result.cols(); i += 3) turn(result.middleCols<3>(i), step.R_inverse);
  return result;
}

/// The lower triangle of `sum` gains S^-1.
void addInverseS(const KalmanUpdate& step, PooledMatrix& sum) {
  if (step.S_inverse.size() > 0) {
    sum += step.S_inverse;
    return;
  }
  const PooledMatrix KtHt = step.H.timesTransposed(*step.Kt);
  for (Eigen::Index i = 0; i < sum.rows(); i += 3) {
    addTurned(KtHt.middleCols<3>(i), -step.R_inverse, sum.middleCols<3>(i));
    sum.block<3, 3>(i, i) += step.R_inverse;
  }
}

} // namespace

std::size_t bytesOf(const DeferredStep& step) {
  return sizeof(DeferredStep) + std::visit([](const auto& s) { return heapOf(s); }, step);
}

void CorrectionSweep::back(const DeferredStep& step) {
  std::visit([this](const auto& s) { back(s); }, step);
}

// x' = F x: correction <- F^T correction.

void CorrectionSweep::back(const Eigen::Ref<const Eigen::MatrixXd>& F,
                           const Pooled<Eigen::VectorXd>& learned) {
  Pooled<Eigen::VectorXd> before = learned;
  before.noalias() += F.transpose() * active();
  size_ = before.size();
  correction_.swap(before);
}

void CorrectionSweep::back(const Propagation& step) {
  const Vector6d gained = step.G.transpose() * active();
  active().segment<6>(kTwist) += gained;
}

/// F = I - K H, and H^T y is learned.
void CorrectionSweep::back(const KalmanUpdate& step) {
  Pooled<Eigen::VectorXd> weighted = step.y;
  weighted.noalias() -= *step.Kt * active();
  step.H.addTransposed(active(), weighted);
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
  active().segment<3>(kPosition) += active().tail<3>();
  size_ -= 3;
}

void CorrectionSweep::back(const Removal& step) {
  size_ += 3;
  if (correction_.size() < size_) {
    Pooled<Eigen::VectorXd> larger = Eigen::VectorXd::Zero(2 * size_);
    larger.head(size_ - 3) = correction_;
    correction_.swap(larger);
  }
  active().tail<3>().setZero();
  if (step.row != size_ - 3) active().segment<3>(step.row).swap(active().tail<3>());
}

void CorrectionSweep::back(const Oblivion& step) { correction_.segment<3>(step.row).setZero(); }

void InformationSweep::back(const DeferredStep& step) {
  std::visit([this](const auto& s) { back(s); }, step);
}

// x' = F x: information <- F^T information F, as its columns and then its rows.

void InformationSweep::back(const Eigen::Ref<const Eigen::MatrixXd>& F,
                            const Eigen::Ref<const Eigen::MatrixXd>& information) {
  const Eigen::MatrixXd before = F.transpose() * active() * F + information;
  size_ = before.rows();
  information_ = before;
}

void InformationSweep::back(const Propagation& step) {
  const Pooled<Eigen::Matrix<double, Eigen::Dynamic, 6>> gained = active() * step.G;
  const Matrix6d twice = step.G.transpose() * gained;
  active().middleCols<6>(kTwist) += gained;
  active().middleRows<6>(kTwist) += gained.transpose();
  active().block<6, 6>(kTwist, kTwist) += twice;
}

/// F = I - K H, and H^T S^-1 H is learned: information + H^T (K^T information K + S^-1) H less the mixed
/// terms, all but the first one within the few columns of H.
void InformationSweep::back(const KalmanUpdate& step) {
  PooledMatrix mixed = active() * (*step.Kt).transpose();
  PooledMatrix own = PooledMatrix::Zero(mixed.cols(), mixed.cols());
  own.triangularView<Eigen::Lower>() += *step.Kt * mixed;
  addInverseS(step, own);
  mirrorLower(own);
  step.H.addTransposed(mixed, -0.5 * own);
  step.H.subtractSymmetric(active(), mixed);
}

void InformationSweep::back(const Transport& step) {
  onBothSides(active(), [&step](Eigen::Ref<Eigen::MatrixXd>& information) {
    auto position = information.middleCols<3>(kPosition);
    for (std::size_t i = 0; i < step.M.size(); ++i) {
      auto own = information.middleCols<3>(State::offsetOf(i));
      eachRows(own.rows(), [&](Eigen::Index row, auto count) {
        constexpr int kRows = decltype(count)::value;
        const Eigen::Matrix<double, kRows, 3> before = own.template middleRows<kRows>(row);
        const Eigen::Matrix<double, kRows, 3> moved = before * step.M[i];
        own.template middleRows<kRows>(row) = moved;
        position.template middleRows<kRows>(row) += before - moved;
      });
    }
  });
}

void InformationSweep::back(const Birth&) {
  active().middleCols<3>(kPosition) += active().rightCols<3>();
  active().middleRows<3>(kPosition) += active().bottomRows<3>();
  size_ -= 3;
}

void InformationSweep::back(const Removal& step) {
  size_ += 3;
  if (information_.rows() < size_) information_.conservativeResize(size_, size_);
  active().rightCols<3>().setZero();
  active().bottomRows<3>().setZero();
  if (step.row == size_ - 3) return;
  active().middleCols<3>(step.row).swap(active().rightCols<3>());
  active().middleRows<3>(step.row).swap(active().bottomRows<3>());
}

void InformationSweep::back(const Oblivion& step) {
  active().middleCols<3>(step.row).setZero();
  active().middleRows<3>(step.row).setZero();
}

ForwardSweep::ForwardSweep(Eigen::Index size, Eigen::Index rows, Eigen::Index columns)
    : rows_(size),
      columns_(size),
      X_(size + rows, columns),
      gram_(PooledMatrix::Zero(size + rows, size + rows)),
      learned_(Eigen::VectorXd::Zero(size + rows)) {
  active().setIdentity();
}

void ForwardSweep::append(const Pooled<Eigen::Matrix<double, Eigen::Dynamic, 3>>& cross) {
  X_.block(rows_, 0, 3, columns_) = cross.transpose();
  rows_ += 3;
}

void ForwardSweep::forward(const DeferredStep& step) {
  std::visit([this](const auto& s) { forward(s); }, step);
}

void ForwardSweep::forward(const Propagation& step) {
  const Pooled<Eigen::Matrix<double, Eigen::Dynamic, 6>> twist = active().middleCols<6>(kTwist);
  active().noalias() += twist * step.G.transpose();
}

/// With Z = X H^T: X -= Z K^T, and y is learned about by Z S^-1 nu, with Z S^-1 Z^T less of its covariance.
void ForwardSweep::forward(const KalmanUpdate& step) {
  const PooledMatrix Z = step.H.timesTransposed(active());
  active().noalias() -= Z * *step.Kt;
  const PooledMatrix weighted = timesInverseS(step, Z, active());
  gram_.topLeftCorner(rows_, rows_).triangularView<Eigen::Lower>() += weighted * Z.transpose();
  learned_.head(rows_).noalias() += Z * step.y;
}

void ForwardSweep::forward(const Transport& step) {
  const Pooled<Eigen::Matrix<double, Eigen::Dynamic, 3>> position = active().middleCols<3>(kPosition);
  for (std::size_t i = 0; i < step.M.size(); ++i) {
    auto own = active().middleCols<3>(State::offsetOf(i));
    turnAbout(position, own, step.M[i].transpose(), own);
  }
}

void ForwardSweep::forward(const Birth&) {
  columns_ += 3;
  active().rightCols<3>() = active().middleCols<3>(kPosition);
}

void ForwardSweep::forward(const Removal& step) {
  if (step.row != columns_ - 3) active().middleCols<3>(step.row) = active().rightCols<3>();
  columns_ -= 3;
}

void ForwardSweep::forward(const Oblivion& step) { active().middleCols<3>(step.row).setZero(); }

} // namespace vi_ekf_slam::invariant
