#include "vi_ekf_slam/core/invariant/relative_update.hpp"

#include <Eigen/LU>
#include <utility>

#include "vi_ekf_slam/core/invariant/columns3.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/invariant/symmetric.hpp"
#include "vi_ekf_slam/core/invariant/triangular.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr double kWorstCondition = 1e6; // of J: 150 m before a pair of 0.1 m it is 2e3

/// Puts the block of symmetric P at (row, column) where it is in the lower triangle.
void setLower(Eigen::Ref<Eigen::MatrixXd>& P, Eigen::Index row, Eigen::Index column,
              const Eigen::Matrix3d& value) {
  if (row >= column)
    P.block<3, 3>(row, column) = value;
  else
    P.block<3, 3>(column, row) = value.transpose();
}

/// Whose rows begin at `row`.
std::size_t landmarkAt(Eigen::Index row) { return static_cast<std::size_t>((row - kLandmarks) / 3); }

} // namespace

std::optional<RelativeUpdate> RelativeUpdate::make(const SparseRows& H, const Eigen::Matrix3d& noise,
                                                   const PooledMatrix& PHt, const PooledMatrix& L) {
  const Eigen::Index size = PHt.rows();
  if (2 * H.rows() < size) return std::nullopt;
  const auto& blocks = H.blocks();
  if (3 * static_cast<Eigen::Index>(blocks.size()) != 2 * H.rows()) return std::nullopt;
  PooledVector<bool> is_seen(static_cast<std::size_t>(size), false);
  PooledVector<Seen> seen;
  for (std::size_t i = 0; i < blocks.size(); i += 2) {
    const auto &landmark = blocks[i], &body = blocks[i + 1];
    const auto row = 3 * static_cast<Eigen::Index>(i / 2);
    if (landmark.row != row || body.row != row || body.column != kPosition || body.value != -landmark.value)
      return std::nullopt;
    if (landmark.column < kLandmarks || is_seen[static_cast<std::size_t>(landmark.column)])
      return std::nullopt;
    is_seen[static_cast<std::size_t>(landmark.column)] = true;
    const Eigen::Matrix3d inverse = landmark.value.inverse();
    if (!(landmark.value.norm() * inverse.norm() < kWorstCondition)) return std::nullopt;
    seen.push_back({landmark.column, inverse});
  }
  PooledVector<Eigen::Index> others;
  for (Eigen::Index row = 0; row < size; row += 3) {
    if (!is_seen[static_cast<std::size_t>(row)]) others.push_back(row);
  }
  return RelativeUpdate(std::move(seen), std::move(others), noise, PHt, L);
}

RelativeUpdate::RelativeUpdate(PooledVector<Seen> seen, PooledVector<Eigen::Index> others,
                               const Eigen::Matrix3d& noise, const PooledMatrix& PHt, const PooledMatrix& L)
    : seen_(std::move(seen)),
      others_(std::move(others)),
      noise_(noise),
      S_inverse_(L.rows(), L.cols()),
      weighted_(rowsOf(others_.size()), L.cols()) {
  S_inverse_.triangularView<Eigen::Lower>() = L;
  S_inverse_.triangularView<Eigen::StrictlyUpper>().setZero();
  for (std::size_t i = 0; i < others_.size(); ++i)
    weighted_.middleRows<3>(rowsOf(i)) = PHt.middleRows<3>(others_[i]);
  divideByLowerTransposed(weighted_, L);
  gain_ = weighted_;
  divideByLower(gain_, L);
  // L^-1 is solved for from the right, like the gain: what is large and common to all rows of S is small in
  // S^-1 then, and not rounded away.
  invertLower(S_inverse_);
  squareLower(S_inverse_);
  mirrorBlocks(S_inverse_);
}

/// Of a landmark that is seen, K = J^-1 (I - R S^-1) and the position's.
PooledMatrix RelativeUpdate::transposedGain() {
  mirrorLower(S_inverse_);
  PooledMatrix Kt(S_inverse_.rows(), rowsOf(seen_.size() + others_.size()));
  for (std::size_t i = 0; i < others_.size(); ++i)
    Kt.middleCols<3>(others_[i]) = gain_.middleRows<3>(rowsOf(i)).transpose();
  const PooledMatrix position = gain_.topRows<3>().transpose();
  for (std::size_t i = 0; i < seen_.size(); ++i) {
    auto own = Kt.middleCols<3>(seen_[i].row);
    own = position;
    addTurned(S_inverse_.middleCols<3>(rowsOf(i)), -noise_ * seen_[i].J_inverse.transpose(), own);
    own.middleRows<3>(rowsOf(i)) += seen_[i].J_inverse.transpose();
  }
  return Kt;
}

/// `cross` is K R J^-T, with what is seen relative to the body.
RelativeUpdate::Others RelativeUpdate::correctOthers(const Eigen::Ref<const Eigen::MatrixXd>& P,
                                                     const PooledVector<Eigen::Matrix3d>& A,
                                                     const PooledVector<Eigen::Matrix3d>& M) const {
  const Eigen::Index rest = rowsOf(others_.size());
  Others result{PooledMatrix(rest, rest), PooledMatrix(rest, rowsOf(seen_.size()))};
  auto& [own, cross] = result;
  for (std::size_t i = 0; i < others_.size(); ++i) {
    for (std::size_t j = 0; j < others_.size(); ++j)
      own.block<3, 3>(rowsOf(i), rowsOf(j)) = P.block<3, 3>(others_[i], others_[j]);
  }
  own.selfadjointView<Eigen::Lower>().rankUpdate(weighted_, -1.0);
  mirrorLower(own);
  for (std::size_t i = 0; i < seen_.size(); ++i)
    cross.middleCols<3>(rowsOf(i)).noalias() = gain_.middleCols<3>(rowsOf(i)) * A[i];
  if (M.empty()) return result;
  const auto transport = [&](auto&& rows) {
    for (std::size_t i = 0; i < others_.size(); ++i) {
      if (others_[i] < kLandmarks) continue;
      auto landmark = rows.template middleRows<3>(rowsOf(i));
      for (Eigen::Index column = 0; column < rows.cols(); ++column) {
        const Eigen::Vector3d position = rows.col(column).template head<3>();
        const Eigen::Vector3d way = landmark.col(column) - position;
        landmark.col(column) = position + M[landmarkAt(others_[i])] * way;
      }
    }
  };
  transport(cross);
  onBothSides(own, transport);
  return result;
}

void RelativeUpdate::correct(Eigen::Ref<Eigen::MatrixXd> P, const PooledVector<Eigen::Matrix3d>& M) const {
  PooledVector<Eigen::Matrix3d> A, weighted_A; // R^-1 A
  for (const Seen& seen : seen_) {
    weighted_A.push_back(seen.J_inverse.transpose());
    if (!M.empty()) weighted_A.back() *= M[landmarkAt(seen.row)].transpose();
    A.push_back(noise_ * weighted_A.back());
  }
  const auto [own, cross] = correctOthers(P, A, M);
  for (std::size_t i = 0; i < others_.size(); ++i) {
    for (std::size_t j = 0; j <= i; ++j)
      P.block<3, 3>(others_[i], others_[j]) = own.block<3, 3>(rowsOf(i), rowsOf(j));
  }
  const PooledMatrix with_position = cross.topRows<3>().transpose();
  PooledMatrix column(S_inverse_.rows(), 3); // of cov(e_j - xi_p, e_k - xi_p), by A_j^T
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const Eigen::Index first = rowsOf(k), to = seen_[k].row;
    for (std::size_t i = 0; i < others_.size(); ++i)
      setLower(P, others_[i], to, cross.block<3, 3>(rowsOf(i), first) + own.block<3, 3>(rowsOf(i), 0));
    auto below = column.bottomRows(column.rows() - first);
    below.setZero();
    addTurned(S_inverse_.middleCols<3>(first).bottomRows(below.rows()), -A[k], below);
    column.middleRows<3>(first) += weighted_A[k];
    const Eigen::Matrix3d base = cross.block<3, 3>(0, first) + own.topLeftCorner<3, 3>();
    for (std::size_t j = k; j < seen_.size(); ++j) {
      const Eigen::Index row = rowsOf(j);
      setLower(P, seen_[j].row, to,
               base + with_position.middleRows<3>(row) + A[j].transpose() * column.middleRows<3>(row));
    }
  }
  mirrorLower(P);
}

} // namespace vi_ekf_slam::invariant
