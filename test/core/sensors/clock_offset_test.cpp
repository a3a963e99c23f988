// The offset of two clocks, from how differently they say that a body turned.

#include "vi_ekf_slam/core/sensors/clock_offset.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "../numeric.hpp"

namespace vi_ekf_slam::test {
namespace {

TEST(ClockOffset, IsExactWhateverTheBias) {
  Random random(1);
  const Eigen::Vector3d bias(0.1, -0.2, 0.05);
  ClockOffset clock;
  EXPECT_FALSE(clock.estimate());
  for (int i = 0; i < 5; ++i) {
    const Eigen::Vector3d change = random.gaussian<3>(0.5);
    clock.add(change, bias - 0.017 * change, 1e-3);
    EXPECT_EQ(clock.estimate().has_value(), i > 0); // one turn is the bias's
  }
  EXPECT_NEAR(clock.estimate()->tau, -0.017, 1e-12);
  EXPECT_EQ(clock.count(), 5);
}

TEST(ClockOffset, KnowsHowWrongItIs) {
  double all = 0.0, scattered = 0.0;
  constexpr int kRuns = 400, kTurns = 8;
  for (unsigned run = 0; run < kRuns; ++run) {
    Random random(run);
    ClockOffset as_told, worse;
    for (int i = 0; i < kTurns; ++i) {
      const Eigen::Vector3d change = random.gaussian<3>(0.4), noise = random.gaussian<3>(2e-3);
      as_told.add(change, 0.01 * change + noise, 2e-3);
      worse.add(change, 0.01 * change + 5.0 * noise, 2e-3);
    }
    all += std::pow((as_told.estimate()->tau - 0.01) / as_told.estimate()->sigma, 2) / kRuns;
    scattered += std::pow((worse.estimate()->tau - 0.01) / worse.estimate()->sigma, 2) / kRuns;
  }
  EXPECT_NEAR(all, 0.9, 0.2); // sigma is not below what is told
  EXPECT_NEAR(scattered, 1.1, 0.25);
}

TEST(ClockOffset, IsNotKnownOfABodyThatTurnsAlike) {
  ClockOffset clock;
  for (int i = 0; i < 8; ++i)
    clock.add(Eigen::Vector3d(0.3, 0.0, 0.0), Eigen::Vector3d(0.01, 0.0, 0.0), 1e-3);
  EXPECT_FALSE(clock.estimate());
}

} // namespace
} // namespace vi_ekf_slam::test
