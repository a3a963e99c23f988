#include "vi_ekf_slam/core/filter/triangular.hpp"

#include <algorithm>

namespace vi_ekf_slam {
namespace {

constexpr Eigen::Index kSmall = 48;    // rows; below, halving costs more than it saves
constexpr Eigen::Index kSolved = 96;   // the same of a solve
constexpr Eigen::Index kMultiple = 24; // rows that a product's kernel takes at a time

using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kSmall, kSmall>;

/// Where to halve `size` rows.
Eigen::Index halfOf(Eigen::Index size) { return std::max<Eigen::Index>(size / 2 / kMultiple, 1) * kMultiple; }

} // namespace

void addLowerProduct(Eigen::Ref<Eigen::MatrixXd> C, const Eigen::Ref<const Eigen::MatrixXd>& A,
                     const Eigen::Ref<const Eigen::MatrixXd>& B) {
  const Eigen::Index size = C.rows();
  if (size <= kSmall) {
    C.triangularView<Eigen::Lower>() += A.transpose() * B;
    return;
  }
  const Eigen::Index top = halfOf(size), rest = size - top;
  addLowerProduct(C.topLeftCorner(top, top), A.leftCols(top), B.leftCols(top));
  C.bottomLeftCorner(rest, top).noalias() += A.rightCols(rest).transpose() * B.leftCols(top);
  addLowerProduct(C.bottomRightCorner(rest, rest), A.rightCols(rest), B.rightCols(rest));
}

/// The first half first: X1 L11^-T, then (X2 - X1 L21^T) L22^-T.
void divideByLowerTransposed(Eigen::Ref<Eigen::MatrixXd> X, const Eigen::Ref<const Eigen::MatrixXd>& L) {
  const Eigen::Index size = L.rows();
  if (size <= kSolved) {
    L.transpose().triangularView<Eigen::Upper>().solveInPlace<Eigen::OnTheRight>(X);
    return;
  }
  const Eigen::Index top = halfOf(size), rest = size - top;
  divideByLowerTransposed(X.leftCols(top), L.topLeftCorner(top, top));
  X.rightCols(rest).noalias() -= X.leftCols(top) * L.bottomLeftCorner(rest, top).transpose();
  divideByLowerTransposed(X.rightCols(rest), L.bottomRightCorner(rest, rest));
}

void invertLower(Eigen::Ref<Eigen::MatrixXd> L) {
  const Eigen::Index size = L.rows();
  if (size <= kSmall) {
    Small inverse = Small::Identity(size, size);
    L.triangularView<Eigen::Lower>().solveInPlace<Eigen::OnTheRight>(inverse);
    L.triangularView<Eigen::Lower>() = inverse;
    return;
  }
  const Eigen::Index top = halfOf(size), rest = size - top;
  auto below = L.bottomLeftCorner(rest, top);
  invertLower(L.topLeftCorner(top, top));
  invertLower(L.bottomRightCorner(rest, rest));
  const Eigen::MatrixXd moved = below * L.topLeftCorner(top, top).triangularView<Eigen::Lower>();
  below.noalias() = L.bottomRightCorner(rest, rest).triangularView<Eigen::Lower>() * (-moved);
}

void squareLower(Eigen::Ref<Eigen::MatrixXd> T) {
  const Eigen::Index size = T.rows();
  if (size <= kSmall) {
    const Small lower = T.triangularView<Eigen::Lower>();
    T.triangularView<Eigen::Lower>() = lower.transpose() * lower;
    return;
  }
  const Eigen::Index top = halfOf(size), rest = size - top;
  auto below = T.bottomLeftCorner(rest, top);
  squareLower(T.topLeftCorner(top, top));
  addLowerSquare(T.topLeftCorner(top, top), below);
  const Eigen::MatrixXd moved =
      T.bottomRightCorner(rest, rest).triangularView<Eigen::Lower>().transpose() * below;
  below = moved;
  squareLower(T.bottomRightCorner(rest, rest));
}

} // namespace vi_ekf_slam
