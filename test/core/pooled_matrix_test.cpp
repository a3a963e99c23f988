#include "vi_ekf_slam/core/pooled_matrix.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <utility>

namespace vi_ekf_slam {
namespace {

Eigen::MatrixXd numbered(Eigen::Index rows, Eigen::Index cols) {
  Eigen::MatrixXd matrix(rows, cols);
  for (Eigen::Index i = 0; i < matrix.size(); ++i) matrix(i) = static_cast<double>(i + 1);
  return matrix;
}

TEST(PooledMatrix, IsWhatItIsMadeOf) {
  const Eigen::MatrixXd A = numbered(5, 7);
  const PooledMatrix copy = A, product = A * A.transpose(), block = A.block(1, 2, 3, 4);
  EXPECT_EQ(copy, A);
  EXPECT_TRUE(product.isApprox(A * A.transpose(), 1e-15));
  EXPECT_EQ(block, A.block(1, 2, 3, 4));
  EXPECT_EQ(PooledMatrix::Zero(3, 2), Eigen::MatrixXd::Zero(3, 2));
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(copy.data()) % kPoolAlignment, 0u);
}

TEST(PooledMatrix, CopiesAreIndependent) {
  const PooledMatrix A = numbered(4, 4);
  PooledMatrix B = A;
  B(1, 2) = -1.0;
  EXPECT_EQ(A, numbered(4, 4));
  B = A;
  EXPECT_EQ(B, A);
  EXPECT_NE(B.data(), A.data());
  B = *&B;
  EXPECT_EQ(B, A);
}

TEST(PooledMatrix, MovesWithoutACopy) {
  PooledMatrix A = numbered(4, 3);
  const double* const data = A.data();
  PooledMatrix B = std::move(A);
  EXPECT_EQ(B.data(), data);
  EXPECT_EQ(B, numbered(4, 3));
  PooledMatrix C = numbered(2, 2);
  C = std::move(B);
  EXPECT_EQ(C.data(), data);
  C.swap(C);
  EXPECT_EQ(C, numbered(4, 3));
}

TEST(PooledMatrix, TakesAnotherSizeWhenAssigned) {
  PooledMatrix A;
  EXPECT_EQ(A.size(), 0);
  A = numbered(3, 6);
  EXPECT_EQ(A, numbered(3, 6));
  A = numbered(8, 1) * numbered(1, 9);
  EXPECT_EQ(A, numbered(8, 1) * numbered(1, 9));
  A = PooledMatrix();
  EXPECT_EQ(A.size(), 0);
  EXPECT_EQ(PooledMatrix(0, 5).cols(), 5);
}

TEST(PooledMatrix, MayBeAssignedWhatItIsPartOf) {
  PooledMatrix A = numbered(5, 5);
  A = 0.5 * (A + A.transpose());
  EXPECT_EQ(A, 0.5 * (numbered(5, 5) + numbered(5, 5).transpose()));
  A = numbered(5, 5);
  A = A * A;
  EXPECT_EQ(A, numbered(5, 5) * numbered(5, 5));
  A = A.topLeftCorner(2, 3);
  EXPECT_EQ(A, (numbered(5, 5) * numbered(5, 5)).topLeftCorner(2, 3));
}

TEST(PooledMatrix, MayHaveASizeThatIsFixed) {
  using Columns = Pooled<Eigen::Matrix<double, Eigen::Dynamic, 3>>;
  Columns columns;
  EXPECT_EQ(columns.rows(), 0);
  EXPECT_EQ(columns.cols(), 3);
  columns = numbered(9, 3);
  EXPECT_EQ(columns.rows(), 9);
  Pooled<Eigen::VectorXd> vector = numbered(4, 1);
  vector.segment<2>(1) += Eigen::Vector2d(10.0, 20.0);
  EXPECT_EQ(vector, Eigen::Vector4d(1.0, 12.0, 23.0, 4.0));
}

} // namespace
} // namespace vi_ekf_slam
