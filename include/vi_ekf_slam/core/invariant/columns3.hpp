#pragma once

#include <Eigen/Core>
#include <type_traits>

namespace vi_ekf_slam::invariant {

/// Calls `what(row, N)` for eight rows at a time, and then for each that is left: with blocks of so many
/// rows, what is done with three columns is done in registers, in one pass over memory.
template <class What>
void eachRows(Eigen::Index rows, const What& what) {
  Eigen::Index row = 0;
  for (; row + 8 <= rows; row += 8) what(row, std::integral_constant<int, 8>());
  for (; row < rows; ++row) what(row, std::integral_constant<int, 1>());
}

/// result = base + (X - base) A, for n x 3 columns, of which result may be X. Of what is large and common to
/// X and base nothing is lost.
template <class Result, class Columns, class Base>
void turnAbout(const Base& base, const Columns& X, const Eigen::Matrix3d& A, Result&& result) {
  eachRows(base.rows(), [&](Eigen::Index row, auto count) {
    constexpr int kRows = decltype(count)::value;
    const Eigen::Matrix<double, kRows, 3> from = base.template middleRows<kRows>(row);
    const Eigen::Matrix<double, kRows, 3> way = X.template middleRows<kRows>(row) - from;
    result.template middleRows<kRows>(row) = from + way * A;
  });
}

/// result = (X - base) A, for n x 3 columns.
template <class Result, class Columns, class Base>
void turnedFrom(const Base& base, const Columns& X, const Eigen::Matrix3d& A, Result&& result) {
  eachRows(base.rows(), [&](Eigen::Index row, auto count) {
    constexpr int kRows = decltype(count)::value;
    const Eigen::Matrix<double, kRows, 3> way =
        X.template middleRows<kRows>(row) - base.template middleRows<kRows>(row);
    result.template middleRows<kRows>(row).noalias() = way * A;
  });
}

/// X <- X A, for n x 3 columns.
template <class Columns>
void turn(Columns&& X, const Eigen::Matrix3d& A) {
  eachRows(X.rows(), [&](Eigen::Index row, auto count) {
    constexpr int kRows = decltype(count)::value;
    const Eigen::Matrix<double, kRows, 3> own = X.template middleRows<kRows>(row);
    X.template middleRows<kRows>(row).noalias() = own * A;
  });
}

/// result += X A, for n x 3 columns.
template <class Result, class Columns>
void addTurned(const Columns& X, const Eigen::Matrix3d& A, Result&& result) {
  eachRows(X.rows(), [&](Eigen::Index row, auto count) {
    constexpr int kRows = decltype(count)::value;
    const Eigen::Matrix<double, kRows, 3> own = X.template middleRows<kRows>(row);
    result.template middleRows<kRows>(row) += own * A;
  });
}

} // namespace vi_ekf_slam::invariant
