#include "vi_ekf_slam/core/filter/direct_update.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/filter/four_by_three.hpp"
#include "vi_ekf_slam/core/filter/symmetric.hpp"
#include "vi_ekf_slam/core/filter/triangular.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kWorstCondition = 1e6;    // of J: 150 m before a pair of 0.1 m it is 2e3
constexpr double kLargestInnovation = 1e4; // S over R: R - R S^-1 R loses as many digits of what is small

/// The lower triangle alone: the columns of each point, then its rows.
void reexpressLower(Eigen::Ref<Eigen::MatrixXd> P, const std::vector<Variables::Reexpressed>& points) {
  for (const auto& [row, M, N] : points) {
    auto own = P.block<3, 3>(row, row);
    own.triangularView<Eigen::StrictlyUpper>() = own.transpose();
    auto below = P.middleCols<3>(row).bottomRows(P.rows() - row);
    below = below.lazyProduct(M.transpose()).eval();
  }
  for (Eigen::Index column = 0; column < P.cols(); ++column) {
    for (const auto& [row, M, N] : points) {
      if (row + 2 < column) continue;
      const Eigen::Vector3d own = P.col(column).segment<3>(row);
      P.col(column).segment<3>(row).noalias() = M * own;
    }
  }
}

/// y <- y + N x, of a whole matrix.
void addOthers(Eigen::Ref<Eigen::MatrixXd> P, Eigen::Index row, const LinearFunction& N) {
  if (N.isNone()) return;
  P.middleCols<3>(row).noalias() += P.middleCols(N.row, N.J.cols()) * N.J.transpose();
  P.middleRows<3>(row).noalias() += N.J * P.middleRows(N.row, N.J.cols());
}

} // namespace

void reexpress(Eigen::Ref<Eigen::MatrixXd> P, const std::vector<Variables::Reexpressed>& points) {
  if (points.empty()) return;
  reexpressLower(P, points);
  mirrorLower(P);
  for (const auto& point : points) addOthers(P, point.row, point.N);
}

std::optional<DirectUpdate> DirectUpdate::make(const Innovation& in) {
  const Eigen::Index size = in.error().size();
  if (2 * in.rows() < size) return std::nullopt;
  std::vector<bool> is_seen(static_cast<std::size_t>(size), false);
  std::vector<Seen> seen;
  for (std::size_t i = 0; i < in.measurements().size(); ++i) {
    const LinearMeasurement& z = in.measurements()[i];
    if (z.rows() != 3 || z.termCount() == 0 || z.term(0).H.cols() != 3) return std::nullopt;
    const Eigen::Index column = z.term(0).column;
    if (is_seen[static_cast<std::size_t>(column)]) return std::nullopt;
    for (Eigen::Index k = 0; k < 3; ++k) is_seen[static_cast<std::size_t>(column + k)] = true;
    const Eigen::Matrix3d J = z.term(0).H, inverse = J.inverse();
    if (!(J.norm() * inverse.norm() < kWorstCondition)) return std::nullopt;
    const Eigen::Index row = in.rowOf(i);
    for (Eigen::Index k = 0; k < 3; ++k) {
      if (!(in.variance(row + k) < kLargestInnovation * z.noise()(k, k))) return std::nullopt;
    }
    Seen own{column, inverse, z.noise(), {}};
    for (std::size_t k = 1; k < z.termCount(); ++k)
      own.others.push_back({z.term(k).column, inverse * z.term(k).H});
    seen.push_back(std::move(own));
  }
  for (const Seen& s : seen) {
    for (const auto& other : s.others) {
      if (is_seen[static_cast<std::size_t>(other.column)]) return std::nullopt;
    }
  }
  std::vector<Eigen::Index> rest;
  for (Eigen::Index row = 0; row < size; ++row) {
    if (!is_seen[static_cast<std::size_t>(row)]) rest.push_back(row);
  }
  return DirectUpdate(in, std::move(seen), std::move(rest));
}

DirectUpdate::DirectUpdate(const Innovation& in, std::vector<Seen> seen, std::vector<Eigen::Index> rest)
    : seen_(std::move(seen)), rest_(std::move(rest)), S_inverse_(in.rows(), in.rows()) {
  S_inverse_.triangularView<Eigen::Lower>() = in.L();
  S_inverse_.triangularView<Eigen::StrictlyUpper>().setZero();
  // L^-1 is solved for from the right: what is large and common to all rows of S is small in S^-1 then, and
  // not rounded away.
  invertLower(S_inverse_);
  weighted_ = in.PHt(rest_) * S_inverse_.transpose().triangularView<Eigen::Upper>();
  gain_ = weighted_ * S_inverse_.triangularView<Eigen::Lower>();
  squareLower(S_inverse_);
  for (Eigen::Index row = 0; row < in.rows(); row += 3) {
    auto own = S_inverse_.block<3, 3>(row, row);
    own.triangularView<Eigen::StrictlyUpper>() = own.transpose();
  }
}

Eigen::MatrixXd DirectUpdate::inverseS() const { return S_inverse_.selfadjointView<Eigen::Lower>(); }

DirectUpdate::Moved DirectUpdate::movedBy(const std::vector<Variables::Reexpressed>& points) const {
  Moved result;
  std::vector<const Variables::Reexpressed*> at(3 * seen_.size() + rest_.size(), nullptr); // by row
  for (const auto& point : points) {
    if (std::binary_search(rest_.begin(), rest_.end(), point.row))
      result.unseen.push_back(point);
    else
      at[static_cast<std::size_t>(point.row)] = &point;
  }
  for (const Seen& seen : seen_) {
    const Variables::Reexpressed* point = at[static_cast<std::size_t>(seen.row)];
    const Eigen::Matrix3d M = point ? point->M : Eigen::Matrix3d::Identity();
    const Eigen::Matrix3d weighted_A = (M * seen.J_inverse).transpose(), A = seen.noise * weighted_A;
    result.weighted_A.push_back(weighted_A);
    result.A.push_back(A);
    result.A_transposed.emplace_back(A.transpose());
    // From y + G c to y, and what it is re-expressed by.
    for (const LinearMeasurement::Term& other : seen.others)
      result.others.push_back({seen.row, {other.column, -M * other.H}});
    if (point && !point->N.isNone()) result.others.push_back({seen.row, point->N});
  }
  return result;
}

void DirectUpdate::correctRows(Eigen::Ref<Eigen::MatrixXd> X, const Eigen::Ref<const Eigen::MatrixXd>& HX,
                               const Eigen::Ref<const Eigen::MatrixXd>& weighted,
                               const std::vector<Variables::Reexpressed>& points) const {
  const Moved moved = movedBy(points);
  const Eigen::MatrixXd change = gain_ * HX;
  for (Eigen::Index column = 0; column < X.cols(); ++column) {
    auto x = X.col(column);
    for (std::size_t i = 0; i < rest_.size(); ++i)
      x[rest_[i]] -= change(static_cast<Eigen::Index>(i), column);
    for (std::size_t i = 0; i < seen_.size(); ++i)
      x.segment<3>(seen_[i].row) =
          moved.A_transposed[i].times(weighted.col(column).segment<3>(3 * static_cast<Eigen::Index>(i)));
  }
  for (const auto& [row, N] : moved.others)
    X.middleRows<3>(row).noalias() += N.J * X.middleRows(N.row, N.J.cols());
  reexpressRows(X, moved.unseen);
}

/// What is not measured; its covariance with what is, K R J^-T (`cross`); and that of this itself.
void DirectUpdate::correct(Eigen::Ref<Eigen::MatrixXd> P,
                           const std::vector<Variables::Reexpressed>& points) const {
  const Moved moved = movedBy(points);
  const auto rest = static_cast<Eigen::Index>(rest_.size());
  const auto rowOf = [this](Eigen::Index i) { return rest_[static_cast<std::size_t>(i)]; };
  Eigen::MatrixXd own(rest, rest);
  for (Eigen::Index j = 0; j < rest; ++j) {
    for (Eigen::Index i = j; i < rest; ++i) own(i, j) = P(rowOf(i), rowOf(j));
  }
  own.selfadjointView<Eigen::Lower>().rankUpdate(weighted_, -1.0);
  for (Eigen::Index j = 0; j < rest; ++j) {
    for (Eigen::Index i = j; i < rest; ++i) P(rowOf(i), rowOf(j)) = own(i, j);
  }
  Eigen::MatrixXd cross(rest, gain_.cols());
  Eigen::MatrixXd column(S_inverse_.rows(), 3); // of cov(y_j, y_k), by A_j^T
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const Eigen::Index first = 3 * static_cast<Eigen::Index>(k), to = seen_[k].row;
    cross.middleCols<3>(first) = gain_.middleCols<3>(first).lazyProduct(moved.A[k]);
    for (Eigen::Index i = 0; i < rest; ++i) {
      if (rowOf(i) > to)
        P.block<1, 3>(rowOf(i), to) = cross.block<1, 3>(i, first);
      else
        P.block<3, 1>(to, rowOf(i)) = cross.block<1, 3>(i, first).transpose();
    }
    auto below = column.bottomRows(column.rows() - first);
    below = S_inverse_.middleCols<3>(first).bottomRows(below.rows()).lazyProduct(-moved.A[k]);
    column.middleRows<3>(first) += moved.weighted_A[k];
    for (Eigen::Index c = 0; c < 3; ++c) {
      for (std::size_t j = k; j < seen_.size(); ++j) {
        const Eigen::Index row = seen_[j].row;
        const Eigen::Vector3d entries =
            moved.A_transposed[j].times(column.col(c).segment<3>(3 * static_cast<Eigen::Index>(j)));
        if (row >= to)
          P.col(to + c).segment<3>(row) = entries;
        else
          P.row(to + c).segment<3>(row) = entries.transpose();
      }
    }
  }
  const bool are_alone = moved.others.empty() &&
                         std::all_of(moved.unseen.begin(), moved.unseen.end(),
                                     [](const Variables::Reexpressed& point) { return point.N.isNone(); });
  if (are_alone) reexpressLower(P, moved.unseen);
  mirrorLower(P);
  if (are_alone) return;
  for (const auto& [row, N] : moved.others) addOthers(P, row, N);
  reexpress(P, moved.unseen);
}

} // namespace vi_ekf_slam
