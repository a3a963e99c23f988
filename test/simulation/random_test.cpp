#include "vi_ekf_slam/simulation/random.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <vector>

namespace vi_ekf_slam::simulation {
namespace {

constexpr int kDraws = 200000;

struct Moments {
  double mean = 0.0, variance = 0.0, kurtosis = 0.0;
};

template <class Draw>
Moments momentsOf(Draw draw) {
  double s1 = 0.0, s2 = 0.0, s4 = 0.0;
  for (int i = 0; i < kDraws; ++i) {
    const double x = draw();
    s1 += x;
    s2 += x * x;
    s4 += x * x * x * x;
  }
  return {s1 / kDraws, s2 / kDraws - s1 * s1 / kDraws / kDraws, s4 / kDraws / (s2 / kDraws * s2 / kDraws)};
}

TEST(Random, NormalHasZeroMeanUnitVarianceAndKurtosisThree) {
  Random random(1, RandomStream::kMotion);
  const Moments m = momentsOf([&random] { return random.normal(); });
  EXPECT_NEAR(m.mean, 0.0, 4.0 / std::sqrt(kDraws));
  EXPECT_NEAR(m.variance, 1.0, 4.0 * std::sqrt(2.0 / kDraws));
  EXPECT_NEAR(m.kurtosis, 3.0, 0.05);
}

TEST(Random, UniformFillsItsInterval) {
  Random random(2, RandomStream::kMotion);
  double low = 1e9, high = -1e9;
  const Moments m = momentsOf([&] {
    const double x = random.uniform(-1.0, 3.0);
    low = std::min(low, x);
    high = std::max(high, x);
    return x;
  });
  EXPECT_NEAR(m.mean, 1.0, 0.02);
  EXPECT_NEAR(m.variance, 16.0 / 12.0, 0.02);
  EXPECT_GE(low, -1.0);
  EXPECT_LT(high, 3.0);
}

TEST(Random, ExponentialHasMeanAndVarianceOne) {
  Random random(3, RandomStream::kMotion);
  const Moments m = momentsOf([&random] { return random.exponential(); });
  EXPECT_NEAR(m.mean, 1.0, 0.02);
  EXPECT_NEAR(m.variance, 1.0, 0.05);
}

TEST(Random, IntegersReachBothEndsAndNothingBeyond) {
  Random random(4, RandomStream::kMotion);
  int count[3] = {0, 0, 0};
  for (int i = 0; i < 3000; ++i) {
    const int n = random.integer(5, 7);
    ASSERT_GE(n, 5);
    ASSERT_LE(n, 7);
    ++count[n - 5];
  }
  for (const int c : count) EXPECT_NEAR(c, 1000, 130);
}

TEST(Random, SeedAndStreamDetermineTheNumbers) {
  Random a(5, RandomStream::kMotion), same(5, RandomStream::kMotion), other_seed(6, RandomStream::kMotion),
      other_stream(5, RandomStream::kScene);
  const double x = a.normal();
  EXPECT_EQ(x, same.normal());
  EXPECT_NE(x, other_seed.normal());
  EXPECT_NE(x, other_stream.normal());
}

TEST(Random, StreamsOfASeedAreUnrelated) {
  constexpr int kStreams = static_cast<int>(RandomStream::kLast);
  constexpr int kNumbers = 2000;
  std::vector<std::vector<double>> drawn(kStreams + 1);
  for (int s = 1; s <= kStreams; ++s) {
    Random random(5, static_cast<RandomStream>(s));
    for (int i = 0; i < kNumbers; ++i) drawn[s].push_back(random.normal());
  }
  for (int a = 1; a <= kStreams; ++a) {
    for (int b = 1; b < a; ++b) {
      const double product = std::inner_product(drawn[a].begin(), drawn[a].end(), drawn[b].begin(), 0.0);
      EXPECT_LT(std::abs(product / kNumbers), 5.0 / std::sqrt(kNumbers)) << a << ", " << b;
    }
  }
}

} // namespace
} // namespace vi_ekf_slam::simulation
