#include "vi_ekf_slam/core/invariant/kept_matrix.hpp"

#include <gtest/gtest.h>

#include <optional>
#include <thread>
#include <vector>

namespace vi_ekf_slam::invariant {
namespace {

TEST(MatrixStore, KeepsMatricesOfAnySizeAsTheyAre) {
  MatrixStore store;
  std::vector<Eigen::MatrixXd> matrices;
  std::vector<KeptMatrix> kept;
  // From nothing to more than a piece; together several pieces.
  for (const Eigen::Index size : {0, 1, 7, 300, 500, 800, 3, 600}) {
    matrices.emplace_back(Eigen::MatrixXd::Random(size, size + 1));
    kept.push_back(store.keep(matrices.back()));
  }
  for (std::size_t i = 0; i < kept.size(); ++i) EXPECT_EQ(*kept[i], matrices[i]);
}

TEST(MatrixStore, OutlivedByItsMatrices) {
  const Eigen::MatrixXd matrix = Eigen::MatrixXd::Random(40, 30);
  std::optional<MatrixStore> store(std::in_place);
  const KeptMatrix kept = store->keep(matrix);
  store.reset();
  EXPECT_EQ(*kept, matrix);
}

TEST(MatrixStore, AnotherUsesItsPiecesAgain) {
  const Eigen::MatrixXd most_of_a_piece = Eigen::MatrixXd::Constant(600, 600, 1.0);
  MatrixStore store;
  MatrixStore another = store.another();
  const double* place = nullptr;
  {
    const KeptMatrix first = store.keep(most_of_a_piece);
    place = (*first).data();
    const KeptMatrix second = store.keep(most_of_a_piece); // the store goes on to the next piece
    EXPECT_NE((*second).data(), place);
  }
  const KeptMatrix third = another.keep(most_of_a_piece);
  EXPECT_EQ((*third).data(), place);
}

TEST(MatrixStore, CopiesAreFilledFromAnyThread) {
  MatrixStore store;
  store.keep(Eigen::MatrixXd(Eigen::MatrixXd::Zero(10, 10))); // all copies begin in the same piece
  const auto fill = [](MatrixStore own, double value) {
    std::vector<KeptMatrix> kept;
    for (int i = 0; i < 300; ++i)
      kept.push_back(own.keep(Eigen::MatrixXd(Eigen::MatrixXd::Constant(50, 50, value))));
    for (const KeptMatrix& matrix : kept) EXPECT_TRUE((*matrix == Eigen::MatrixXd::Constant(50, 50, value)));
  };
  std::vector<std::thread> threads;
  for (int i = 1; i <= 4; ++i) threads.emplace_back(fill, store, i);
  for (std::thread& thread : threads) thread.join();
}

} // namespace
} // namespace vi_ekf_slam::invariant
