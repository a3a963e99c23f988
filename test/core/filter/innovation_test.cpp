#include "vi_ekf_slam/core/filter/innovation.hpp"

#include <cmath>
#include <limits>

#include "states.hpp"

namespace vi_ekf_slam::test {
namespace {

/// One of each number of rows, of up to three terms, some of which overlap.
std::vector<LinearMeasurement> anyMeasurements(Random& random, Eigen::Index size) {
  std::vector<LinearMeasurement> all;
  for (const Eigen::Index rows : {3, 1, 6, 2, 3, 5, 4, 3}) {
    LinearMeasurement z(randomMatrix(random, rows, 1), randomCovariance(random, rows, 0.3));
    const auto terms = static_cast<int>(random.uniform(0.5, 3.5));
    for (int k = 0; k < terms; ++k) {
      const auto cols = rows == 3 ? 3 : static_cast<Eigen::Index>(random.uniform(1.0, 6.99));
      const auto column = static_cast<Eigen::Index>(random.uniform(0.0, static_cast<double>(size - cols)));
      z.by(column, randomMatrix(random, rows, cols));
    }
    all.push_back(z);
  }
  return all;
}

Eigen::MatrixXd factorOf(const Innovation& in) { return in.L().triangularView<Eigen::Lower>(); }

TEST(InnovationTest, IsTheTextbooks) {
  Random random(1);
  const Eigen::MatrixXd P = randomCovariance(random, 30, 1.0);
  for (int run = 0; run < 10; ++run) {
    const auto all = anyMeasurements(random, 30);
    const DenseMeasurement z = denseOf(all, 30);
    const Eigen::MatrixXd S = z.H * P * z.H.transpose() + z.R;
    Innovation in(P, all);
    ASSERT_EQ(in.rows(), S.rows());
    for (std::size_t i = 0; i < all.size(); ++i) {
      for (std::size_t j = 0; j <= i; ++j) {
        EXPECT_LT(distance(Eigen::MatrixXd(in.S(i, j)),
                           S.block(in.rowOf(i), in.rowOf(j), all[i].rows(), all[j].rows())),
                  1e-12);
      }
      const Eigen::VectorXd residual = all[i].residual();
      const Eigen::MatrixXd own = S.block(in.rowOf(i), in.rowOf(i), all[i].rows(), all[i].rows());
      EXPECT_NEAR(in.nisOf(i), residual.dot(inverseOf(own) * residual), 1e-9);
    }
    ASSERT_TRUE(in.factorise());
    EXPECT_LT(distance(in.PHt(), P * z.H.transpose()), 1e-12);
    EXPECT_LT(distance(factorOf(in) * factorOf(in).transpose(), S), 1e-11);
    EXPECT_NEAR(in.nis(), z.residual.dot(inverseOf(S) * z.residual), 1e-9);
    EXPECT_LT(distance(in.error(), P * z.H.transpose() * inverseOf(S) * z.residual), 1e-10);
    EXPECT_EQ(distance(in.residual(), z.residual), 0.0);
  }
}

TEST(InnovationTest, OfThoseThatWereKeptIsThatOfThemAlone) {
  Random random(2);
  const Eigen::MatrixXd P = randomCovariance(random, 30, 1.0);
  for (int run = 0; run < 20; ++run) {
    const auto all = anyMeasurements(random, 30);
    std::vector<bool> chosen;
    std::vector<LinearMeasurement> some;
    for (const LinearMeasurement& z : all) {
      chosen.push_back(random.uniform(0.0, 1.0) < 0.6);
      if (chosen.back()) some.push_back(z);
    }
    Innovation kept(P, all), alone(P, some);
    kept.putFirst(chosen);
    kept.drop();
    ASSERT_EQ(kept.rows(), alone.rows());
    ASSERT_EQ(kept.measurements().size(), some.size());
    for (std::size_t i = 0; i < some.size(); ++i) {
      EXPECT_EQ(kept.rowOf(i), alone.rowOf(i));
      for (std::size_t j = 0; j <= i; ++j)
        EXPECT_LT(distance(Eigen::MatrixXd(kept.S(i, j)), Eigen::MatrixXd(alone.S(i, j))), 1e-13);
    }
    if (some.empty()) continue;
    ASSERT_TRUE(kept.factorise() && alone.factorise());
    EXPECT_LT(distance(kept.PHt(), alone.PHt()), 1e-13);
    EXPECT_LT(distance(kept.error(), alone.error()), 1e-11);
    EXPECT_NEAR(kept.nis(), alone.nis(), 1e-10);
    EXPECT_LT(distance(factorOf(kept), factorOf(alone)), 1e-11);
  }
}

TEST(InnovationTest, TakesThoseThatWaitedAsIfTheyHadBeenThere) {
  Random random(4);
  const Eigen::MatrixXd P = randomCovariance(random, 30, 1.0);
  int accepted = 0;
  for (int run = 0; run < 40; ++run) {
    const auto all = anyMeasurements(random, 30);
    std::vector<bool> chosen, passes;
    std::vector<LinearMeasurement> first, waiting, second;
    for (const LinearMeasurement& z : all) {
      chosen.push_back(random.uniform(0.0, 1.0) < 0.6);
      (chosen.back() ? first : waiting).push_back(z);
    }
    if (first.empty()) continue;
    Innovation in(P, all), alone(P, first);
    in.putFirst(chosen);
    ASSERT_TRUE(in.factorise() && alone.factorise());
    EXPECT_NEAR(in.nis(), alone.nis(), 1e-10);
    EXPECT_LT(distance(in.error(), alone.error()), 1e-11);
    // What the others say after the first ones have corrected the filter.
    const Eigen::MatrixXd root = alone.PHt() * factorOf(alone).transpose().inverse();
    const Eigen::MatrixXd corrected = P - root * root.transpose();
    for (std::size_t i = 0; i < waiting.size(); ++i) {
      Eigen::VectorXd residual = Eigen::VectorXd::Zero(waiting[i].rows());
      waiting[i].addProduct(Eigen::MatrixXd(alone.error()), residual);
      LinearMeasurement left(SmallVector(waiting[i].residual() - residual), waiting[i].noise());
      for (const auto& term : waiting[i]) left.by(term.column, term.H);
      EXPECT_NEAR(in.nisOf(first.size() + i), Innovation(corrected, {left}).nisOf(0), 1e-8);
      passes.push_back(random.uniform(0.0, 1.0) < 0.5);
      if (passes.back()) second.push_back(waiting[i]);
    }
    ASSERT_TRUE(in.accept(passes));
    accepted += static_cast<int>(second.size());
    std::vector<LinearMeasurement> both = first;
    both.insert(both.end(), second.begin(), second.end());
    Innovation together(P, both);
    ASSERT_TRUE(together.factorise());
    ASSERT_EQ(in.measurements().size(), both.size());
    EXPECT_LT(distance(in.PHt(), together.PHt()), 1e-13);
    EXPECT_LT(distance(in.error(), together.error()), 1e-11);
    EXPECT_LT(distance(in.residual(), together.residual()), 1e-15);
    EXPECT_NEAR(in.nis(), together.nis(), 1e-10);
    EXPECT_LT(distance(factorOf(in), factorOf(together)), 1e-11);
    for (Eigen::Index row = 0; row < in.rows(); ++row)
      EXPECT_NEAR(in.variance(row), together.variance(row), 1e-12);
  }
  EXPECT_GT(accepted, 20);
}

TEST(InnovationTest, CannotBeUsedWhereItIsNotOne) {
  Random random(3);
  const Eigen::MatrixXd P = randomCovariance(random, 6, 1.0);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto of = [&](const Eigen::Vector3d& residual, const Eigen::Matrix3d& noise) {
    return Innovation(P, {LinearMeasurement(residual, noise).by(2, Eigen::Matrix3d::Identity())});
  };
  const Eigen::Vector3d one = Eigen::Vector3d::Ones();
  const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
  EXPECT_TRUE(of(one, I).factorise());
  EXPECT_FALSE(of(one, -100.0 * I).factorise());
  EXPECT_TRUE(std::isnan(of(one, -100.0 * I).nisOf(0)));
  EXPECT_FALSE(of(one, nan * I).factorise());
  EXPECT_FALSE(of(nan * one, I).factorise());
  EXPECT_FALSE(of(std::numeric_limits<double>::infinity() * one, I).factorise());
  EXPECT_FALSE(Innovation(nan * P, {LinearMeasurement(one, I).by(2, I)}).factorise());
}

TEST(InnovationTest, KnowsWhatTakesPart) {
  LinearMeasurement z(Eigen::Vector3d::Zero(), Eigen::Matrix3d::Identity());
  EXPECT_TRUE(z.isWithin(0));
  z.by(4, Eigen::Matrix3d::Identity());
  EXPECT_TRUE(z.isWithin(7));
  EXPECT_FALSE(z.isWithin(6));
  z.by(0, Eigen::Matrix3d::Identity()).by(10, Eigen::Vector3d::Ones());
  EXPECT_FALSE(z.isWithin(10));
  EXPECT_TRUE(z.isWithin(11));
  EXPECT_EQ(z.termCount(), 3u);
}

} // namespace
} // namespace vi_ekf_slam::test
