#include "vi_ekf_slam/core/filter/triangular.hpp"

#include <gtest/gtest.h>

#include "states.hpp"
#include "vi_ekf_slam/core/filter/symmetric.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kAbove = 1e300; // above the diagonal, where nobody is to look

/// Lower triangular, well conditioned.
Eigen::MatrixXd lowerOf(Random& random, Eigen::Index size) {
  const Eigen::MatrixXd A = randomMatrix(random, size, size);
  Eigen::MatrixXd L = (A * A.transpose() + Eigen::MatrixXd::Identity(size, size)).llt().matrixL();
  L.triangularView<Eigen::StrictlyUpper>().setConstant(kAbove);
  return L;
}

Eigen::MatrixXd belowOf(const Eigen::MatrixXd& matrix) { return matrix.triangularView<Eigen::Lower>(); }

void expectUntouchedAbove(const Eigen::MatrixXd& matrix) {
  for (Eigen::Index j = 0; j < matrix.cols(); ++j) {
    for (Eigen::Index i = 0; i < j; ++i) ASSERT_EQ(matrix(i, j), kAbove) << i << ' ' << j;
  }
}

class Triangular : public ::testing::TestWithParam<Eigen::Index> {};

TEST_P(Triangular, InverseTimesTheMatrixIsTheIdentity) {
  Random random(1);
  const Eigen::MatrixXd L = lowerOf(random, GetParam());
  Eigen::MatrixXd T = L;
  invertLower(T);
  expectUntouchedAbove(T);
  EXPECT_LT(distance(belowOf(T) * belowOf(L), Eigen::MatrixXd::Identity(L.rows(), L.cols())), 1e-11);
}

TEST_P(Triangular, QuotientTimesTheMatrixIsTheDividend) {
  Random random(4);
  const Eigen::MatrixXd L = lowerOf(random, GetParam()), X = randomMatrix(random, 20, GetParam());
  Eigen::MatrixXd Z = X;
  divideByLowerTransposed(Z, L);
  EXPECT_LT(distance(Z * belowOf(L).transpose(), X), 1e-12 * (1.0 + X.norm()));
}

TEST_P(Triangular, SquareIsTheProductOfTheTransposeAndTheMatrix) {
  Random random(2);
  const Eigen::MatrixXd T = lowerOf(random, GetParam());
  Eigen::MatrixXd square = T;
  squareLower(square);
  expectUntouchedAbove(square);
  const Eigen::MatrixXd expected = belowOf(belowOf(T).transpose() * belowOf(T));
  EXPECT_LT(distance(belowOf(square), expected), 1e-13 * (1.0 + expected.norm()));
}

TEST_P(Triangular, SquareOfAnotherIsAddedAndNothingAbove) {
  Random random(3);
  const Eigen::MatrixXd A = randomMatrix(random, 20, GetParam()), before = lowerOf(random, GetParam());
  Eigen::MatrixXd C = before;
  addLowerSquare(C, A);
  expectUntouchedAbove(C);
  EXPECT_LT(distance(belowOf(C), belowOf(before) + belowOf(A.transpose() * A)), 1e-12 * (1.0 + C.norm()));
}

TEST_P(Triangular, MirrorsAndSubtractsSquaresAsDenseAlgebraDoes) {
  Random random(5);
  const Eigen::Index size = GetParam();
  const Eigen::MatrixXd P = randomCovariance(random, size, 1.0);
  Eigen::MatrixXd lower = P;
  lower.triangularView<Eigen::StrictlyUpper>().setConstant(kAbove);
  mirrorLower(lower);
  EXPECT_EQ(distance(lower, Eigen::MatrixXd(P.selfadjointView<Eigen::Lower>())), 0.0);
  for (const Eigen::Index cols : {3, 40}) {
    const Eigen::MatrixXd A = randomMatrix(random, size, cols);
    Eigen::MatrixXd Q = P;
    subtractSquare(Q, A);
    EXPECT_LT(distance(Q, P - A * A.transpose()), 1e-12 * (1.0 + P.norm()));
    EXPECT_LT(distance(Q, Q.transpose()), 1e-13 * (1.0 + P.norm()));
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, Triangular, ::testing::Values(1, 3, 47, 48, 49, 96, 145, 301));

} // namespace
} // namespace vi_ekf_slam::test
