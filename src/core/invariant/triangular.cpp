#include "vi_ekf_slam/core/invariant/triangular.hpp"

#include <algorithm>

namespace vi_ekf_slam::invariant {
namespace {

constexpr Eigen::Index kSmall = 48;    // rows; below, halving costs more than it saves
constexpr Eigen::Index kMultiple = 24; // rows that a product's kernel takes at a time

/// Where to halve `size` rows.
Eigen::Index halfOf(Eigen::Index size) { return std::max<Eigen::Index>(size / 2 / kMultiple, 1) * kMultiple; }

} // namespace

void addLowerProduct(Eigen::Ref<Eigen::MatrixXd> C, const Eigen::Ref<const Eigen::MatrixXd>& A,
                     const Eigen::Ref<const Eigen::MatrixXd>& B) {
  const Eigen::Index size = C.rows();
  if (size <= kSmall) {
    C.triangularView<Eigen::Lower>() += A * B;
    return;
  }
  const Eigen::Index top = halfOf(size), rest = size - top;
  addLowerProduct(C.topLeftCorner(top, top), A.topRows(top), B.leftCols(top));
  C.bottomLeftCorner(rest, top).noalias() += A.bottomRows(rest) * B.leftCols(top);
  addLowerProduct(C.bottomRightCorner(rest, rest), A.bottomRows(rest), B.rightCols(rest));
}

void invertLower(Eigen::Ref<Eigen::MatrixXd> L) {
  const Eigen::Index size = L.rows();
  if (size <= kSmall) {
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(size, size);
    L.triangularView<Eigen::Lower>().solveInPlace<Eigen::OnTheRight>(inverse);
    L.triangularView<Eigen::Lower>() = inverse;
    return;
  }
  const Eigen::Index top = halfOf(size), rest = size - top;
  auto below = L.bottomLeftCorner(rest, top);
  invertLower(L.topLeftCorner(top, top));
  invertLower(L.bottomRightCorner(rest, rest));
  const Eigen::MatrixXd moved = below * L.topLeftCorner(top, top).triangularView<Eigen::Lower>();
  below.noalias() = -(L.bottomRightCorner(rest, rest).triangularView<Eigen::Lower>() * moved);
}

void squareLower(Eigen::Ref<Eigen::MatrixXd> T) {
  const Eigen::Index size = T.rows();
  if (size <= kSmall) {
    const Eigen::MatrixXd lower = T.triangularView<Eigen::Lower>();
    T.triangularView<Eigen::Lower>() = lower.transpose() * lower;
    return;
  }
  const Eigen::Index top = halfOf(size), rest = size - top;
  auto below = T.bottomLeftCorner(rest, top);
  squareLower(T.topLeftCorner(top, top));
  addLowerProduct(T.topLeftCorner(top, top), below.transpose(), below);
  below = (T.bottomRightCorner(rest, rest).triangularView<Eigen::Lower>().transpose() * below).eval();
  squareLower(T.bottomRightCorner(rest, rest));
}

} // namespace vi_ekf_slam::invariant
