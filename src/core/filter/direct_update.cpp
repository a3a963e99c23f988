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

} // namespace

namespace {

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

/// `cross` is K R J^-T.
DirectUpdate::Rest DirectUpdate::correctRest(const Eigen::Ref<const Eigen::MatrixXd>& P,
                                             const std::vector<Eigen::Matrix3d>& A) const {
  const auto rest = static_cast<Eigen::Index>(rest_.size());
  Rest result{Eigen::MatrixXd(rest, rest), Eigen::MatrixXd(rest, gain_.cols())};
  for (Eigen::Index j = 0; j < rest; ++j) {
    for (Eigen::Index i = j; i < rest; ++i)
      result.own(i, j) = P(rest_[static_cast<std::size_t>(i)], rest_[static_cast<std::size_t>(j)]);
  }
  result.own.selfadjointView<Eigen::Lower>().rankUpdate(weighted_, -1.0);
  for (std::size_t i = 0; i < seen_.size(); ++i) {
    const auto column = 3 * static_cast<Eigen::Index>(i);
    result.cross.middleCols<3>(column) = gain_.middleCols<3>(column).lazyProduct(A[i]);
  }
  return result;
}

void DirectUpdate::correct(Eigen::Ref<Eigen::MatrixXd> P,
                           const std::vector<Variables::Reexpressed>& points) const {
  std::vector<const Eigen::Matrix3d*> M(static_cast<std::size_t>(P.rows()), nullptr); // by row
  bool are_alone = std::all_of(seen_.begin(), seen_.end(), [](const Seen& s) { return s.others.empty(); });
  for (const auto& point : points) {
    M[static_cast<std::size_t>(point.row)] = &point.M;
    are_alone = are_alone && point.N.isNone();
  }
  std::vector<Eigen::Matrix3d> A, weighted_A; // R^-1 A
  A.reserve(seen_.size());
  weighted_A.reserve(seen_.size());
  for (const Seen& seen : seen_) {
    weighted_A.push_back(seen.J_inverse.transpose());
    const Eigen::Matrix3d* moved = M[static_cast<std::size_t>(seen.row)];
    if (moved) weighted_A.back() *= moved->transpose();
    A.push_back(seen.noise * weighted_A.back());
  }
  std::vector<FourByThree> A_transposed;
  A_transposed.reserve(seen_.size());
  for (const Eigen::Matrix3d& a : A) A_transposed.emplace_back(a.transpose());
  const auto [own, cross] = correctRest(P, A);
  const auto rest = static_cast<Eigen::Index>(rest_.size());
  for (Eigen::Index j = 0; j < rest; ++j) {
    for (Eigen::Index i = j; i < rest; ++i)
      P(rest_[static_cast<std::size_t>(i)], rest_[static_cast<std::size_t>(j)]) = own(i, j);
  }
  Eigen::MatrixXd column(S_inverse_.rows(), 3); // of cov(y_j, y_k), by A_j^T
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const Eigen::Index first = 3 * static_cast<Eigen::Index>(k), to = seen_[k].row;
    for (Eigen::Index i = 0; i < rest; ++i) {
      const Eigen::Index row = rest_[static_cast<std::size_t>(i)];
      if (row > to)
        P.block<1, 3>(row, to) = cross.block<1, 3>(i, first);
      else
        P.block<3, 1>(to, row) = cross.block<1, 3>(i, first).transpose();
    }
    auto below = column.bottomRows(column.rows() - first);
    below = S_inverse_.middleCols<3>(first).bottomRows(below.rows()).lazyProduct(-A[k]);
    column.middleRows<3>(first) += weighted_A[k];
    for (Eigen::Index c = 0; c < 3; ++c) {
      for (std::size_t j = k; j < seen_.size(); ++j) {
        const Eigen::Index row = seen_[j].row;
        const Eigen::Vector3d entries =
            A_transposed[j].times(column.col(c).segment<3>(3 * static_cast<Eigen::Index>(j)));
        if (row >= to)
          P.col(to + c).segment<3>(row) = entries;
        else
          P.row(to + c).segment<3>(row) = entries.transpose();
      }
    }
  }
  std::vector<Variables::Reexpressed> unseen;
  for (const auto& point : points) {
    if (std::binary_search(rest_.begin(), rest_.end(), point.row)) unseen.push_back(point);
  }
  if (are_alone) reexpressLower(P, unseen);
  mirrorLower(P);
  if (are_alone) return;
  // From y + G c to y.
  for (const Seen& seen : seen_) {
    for (const LinearMeasurement::Term& other : seen.others) {
      const Eigen::Matrix3d* moved = M[static_cast<std::size_t>(seen.row)];
      const SmallMatrix G = moved ? SmallMatrix(*moved * other.H) : other.H;
      P.middleCols<3>(seen.row).noalias() -= P.middleCols(other.column, G.cols()) * G.transpose();
      P.middleRows<3>(seen.row).noalias() -= G * P.middleRows(other.column, G.cols());
    }
  }
  for (const auto& point : points) {
    if (!std::binary_search(rest_.begin(), rest_.end(), point.row)) addOthers(P, point.row, point.N);
  }
  reexpress(P, unseen);
}

} // namespace vi_ekf_slam
