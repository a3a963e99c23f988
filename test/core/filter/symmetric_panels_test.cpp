#include "vi_ekf_slam/core/filter/symmetric_panels.hpp"

#include <gtest/gtest.h>

#include "../numeric.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

Eigen::MatrixXd symmetric(Eigen::Index n, unsigned seed) {
  Random random(seed);
  Eigen::MatrixXd A(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) A(i, j) = A(j, i) = random.uniform(-1.0, 1.0);
  }
  return A;
}

Eigen::MatrixXd denseOf(const SymmetricPanels& P) { return P.middleRows(0, P.rows()); }

// Of no, one, part of a and several panels.
constexpr Eigen::Index kSizes[] = {1, 7, 255, 256, 257, 600};

TEST(SymmetricPanels, IsTheMatrixThatItIsGiven) {
  EXPECT_EQ(denseOf(SymmetricPanels()).size(), 0);
  for (const Eigen::Index n : kSizes) {
    const Eigen::MatrixXd A = symmetric(n, 1);
    const SymmetricPanels P(A);
    EXPECT_EQ(P.rows(), n);
    EXPECT_EQ(denseOf(P), A);
    const Eigen::Index row = n / 2, column = n / 3, count = n - row;
    EXPECT_EQ(P.middleRows(row, count), A.middleRows(row, count));
    EXPECT_EQ(P.block(row, column, count, n - column), A.block(row, column, count, n - column));
    EXPECT_EQ(P(column, row), A(column, row));
  }
}

TEST(SymmetricPanels, GrowsAndKeepsWhatIsSet) {
  for (const Eigen::Index n : kSizes) {
    const Eigen::Index old = (n + 2) / 3, more = n - old;
    if (more == 0) continue;
    const Eigen::MatrixXd A = symmetric(n, 2);
    SymmetricPanels P(A.topLeftCorner(old, old));
    P.resize(n);
    P.set(old, 0, A.block(old, 0, more, old));
    P.set(old, old, A.block(old, old, more, more));
    EXPECT_EQ(denseOf(P), A) << n;
    // Rows that are products.
    const Eigen::MatrixXd L = symmetric(more, 3), R = A.block(old, 0, more, old);
    P.setProduct(old, L, R);
    EXPECT_LT(distance(P.block(old, 0, more, old), L * R), 1e-10 * static_cast<double>(n)) << n;
    EXPECT_EQ(P.block(old, old, more, more), A.block(old, old, more, more));
  }
}

TEST(SymmetricPanels, SubtractsAProductFromItsFirstRows) {
  for (const Eigen::Index n : kSizes) {
    const Eigen::Index m = n - n / 4;
    Eigen::MatrixXd A = symmetric(n, 4);
    SymmetricPanels P(A);
    const Eigen::MatrixXd W = symmetric(m, 5).topRows(std::min<Eigen::Index>(m, 9));
    P.subtractProduct(W, W);
    A.topLeftCorner(m, m) -= W.transpose() * W;
    EXPECT_LT(distance(denseOf(P), A), 1e-10);
  }
}

TEST(SymmetricPanels, KeepsTheRowsThatItIsToldTo) {
  Random random(6);
  for (const Eigen::Index n : kSizes) {
    for (const double share : {0.0, 0.4, 0.97, 1.0}) {
      const Eigen::MatrixXd A = symmetric(n, 7);
      std::vector<Eigen::Index> kept;
      for (Eigen::Index i = 0; i < n; ++i) {
        if (random.uniform(0.0, 1.0) < share) kept.push_back(i);
      }
      SymmetricPanels P(A);
      P.keep(kept);
      const auto count = static_cast<Eigen::Index>(kept.size());
      ASSERT_EQ(P.rows(), count);
      const Eigen::MatrixXd expected = Eigen::MatrixXd::NullaryExpr(count, count, [&](auto i, auto j) {
        return A(kept[static_cast<std::size_t>(i)], kept[static_cast<std::size_t>(j)]);
      });
      EXPECT_EQ(denseOf(P), expected) << n << " " << share;
    }
  }
}

} // namespace
} // namespace vi_ekf_slam
