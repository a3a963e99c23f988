// What an IMU says of a time between two of its samples.

#include "vi_ekf_slam/core/sensors/imu_track.hpp"

#include <gtest/gtest.h>

#include "../motion/inertial_core.hpp"

namespace vi_ekf_slam {
namespace {

using test::distance;
using test::imuSample;

const ImuNoise kNoise{0.01, 0.1, 1e-3, 1e-2};

/// Samples every 0.01 s, the last one reached at 10 s, of a rate and acceleration that grow with the time.
ImuTrack growing(bool noise_given = true, double next = 10.01) {
  ImuTrack imu(kNoise, noise_given);
  const auto at = [](double t) {
    return imuSample(t, t * Eigen::Vector3d(1.0, -2.0, 3.0), t * Eigen::Vector3d(-4.0, 5.0, 6.0));
  };
  imu.reach(at(9.99));
  imu.reach(at(10.0));
  imu.expect(at(next));
  return imu;
}

TEST(ImuTrack, IsLinearBetweenTwoSamplesSoThatAFrameBetweenThemGetsItsShare) {
  const ImuTrack imu = growing();
  for (const auto& [from, to] : {std::pair{10.0, 10.01}, {10.0, 10.004}, {10.004, 10.01}, {10.002, 10.003}}) {
    const ImuInterval over = imu.over(fromSeconds(from), fromSeconds(to));
    const double middle = 0.5 * (from + to);
    EXPECT_LT(distance(over.rate, middle * Eigen::Vector3d(1.0, -2.0, 3.0)), 1e-7);
    EXPECT_LT(distance(over.acceleration, middle * Eigen::Vector3d(-4.0, 5.0, 6.0)), 1e-7);
  }
  EXPECT_LT(distance(imu.rateAt(fromSeconds(10.0025)), 10.0025 * Eigen::Vector3d(1.0, -2.0, 3.0)), 1e-7);
}

TEST(ImuTrack, IsTheParabolaThroughThreeSamplesThatAreNotQuiteRegular) {
  const auto rate = [](double t) -> Eigen::Vector3d { return t * t * Eigen::Vector3d(30.0, -20.0, 10.0); };
  const auto integral = [](double t) -> Eigen::Vector3d {
    return t * t * t / 3.0 * Eigen::Vector3d(30.0, -20.0, 10.0);
  };
  ImuTrack imu(kNoise, true);
  for (const double t : {1.0, 1.02}) imu.reach(imuSample(t, rate(t), -2.0 * rate(t)));
  imu.expect(imuSample(1.05, rate(1.05), -2.0 * rate(1.05)));
  for (const auto& [from, to] : {std::pair{1.02, 1.05}, {1.02, 1.03}, {1.03, 1.045}}) {
    const ImuInterval over = imu.over(fromSeconds(from), fromSeconds(to));
    const Eigen::Vector3d mean = (integral(to) - integral(from)) / (to - from);
    EXPECT_LT(distance(over.rate, mean), 1e-6);
    EXPECT_LT(distance(over.acceleration, -2.0 * mean), 1e-6);
  }
}

TEST(ImuTrack, IsLinearBehindASampleThatCameInABurst) {
  ImuTrack imu(kNoise, true);
  const Eigen::Vector3d noise(0.01, -0.01, 0.02), none = Eigen::Vector3d::Zero();
  for (const auto& [t, rate] : {std::pair{1.0, none}, {1.0001, noise}}) imu.reach(imuSample(t, rate, none));
  imu.expect(imuSample(1.01, none, none));
  EXPECT_LT(distance(imu.over(fromSeconds(1.0001), fromSeconds(1.01)).rate, 0.5 * noise), 1e-12);
}

// One that lacks it is not one in free fall; of an accelerometer that is silent less and less is known.
TEST(ImuTrack, HoldsTheAccelerationThroughSamplesThatHaveNone) {
  ImuTrack imu(kNoise, true);
  const Eigen::Vector3d rate(0.1, 0.2, 0.3), acceleration(1.0, 2.0, 9.0);
  imu.reach(imuSample(1.0, rate, acceleration));
  double density = 0.0;
  for (int i = 1; i <= 100; ++i) {
    ImuSample silent = imuSample(1.0 + 0.01 * i, rate, acceleration);
    silent.acceleration.reset();
    imu.expect(silent);
    const ImuInterval over = imu.over(fromSeconds(1.0 + 0.01 * (i - 1)), silent.stamp);
    EXPECT_LT(distance(over.acceleration, acceleration), 1e-12);
    EXPECT_LT(distance(over.rate, rate), 1e-12);
    if (i == 1) density = over.acceleration_density.trace();
    EXPECT_TRUE(i < 100 || over.acceleration_density.trace() > 1000.0 * density);
    imu.reach(silent);
  }
}

TEST(ImuTrack, HoldsTheLastSampleWhereNoOtherIsKnownAndTheFirstBeforeIt) {
  ImuTrack imu(kNoise, true);
  EXPECT_EQ(imu.rateAt(fromSeconds(1.0)), Eigen::Vector3d::Zero());
  EXPECT_EQ(imu.over(fromSeconds(1.0), fromSeconds(1.1)).acceleration, Eigen::Vector3d::Zero());
  const Eigen::Vector3d rate(0.1, 0.2, 0.3), acceleration(1.0, 2.0, 9.0);
  imu.expect(imuSample(2.0, rate, acceleration));
  EXPECT_EQ(imu.rateAt(fromSeconds(1.0)), rate);
  imu.reach(imuSample(2.0, rate, acceleration));
  EXPECT_EQ(imu.over(fromSeconds(2.0), fromSeconds(2.1)).acceleration, acceleration);
  // Never beyond the two samples.
  imu.expect(imuSample(2.1, 3.0 * rate, acceleration));
  EXPECT_LT(distance(imu.rateAt(fromSeconds(9.0)), 3.0 * rate), 1e-15);
  EXPECT_LT(distance(imu.rateAt(fromSeconds(1.0)), rate), 1e-15);
}

TEST(ImuTrack, DensitiesAreTheCalibrationsWhereItIsGiven) {
  ImuTrack imu = growing(true);
  ImuSample noisy = imuSample(10.01, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  noisy.covariance = noisy.acceleration_covariance = isotropic(7.0);
  imu.reach(noisy);
  const ImuInterval over = imu.over(fromSeconds(10.01), fromSeconds(10.02));
  EXPECT_LT(distance(over.rate_density, isotropic(0.01)), 1e-15);
  EXPECT_LT(distance(over.acceleration_density, isotropic(0.1)), 1e-15);
  // Of one sample, at 100 Hz: the density times the rate.
  EXPECT_LT(distance(imu.gyroNoise(noisy), 100.0 * isotropic(0.01)), 1e-12);
}

TEST(ImuTrack, DensitiesAreAMessagesCovarianceTimesThePeriodWhereItHasOne) {
  for (const double period : {0.0025, 0.01, 0.1}) {
    ImuTrack imu(kNoise, false);
    ImuSample noisy = imuSample(10.0, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
    imu.reach(noisy);
    noisy.stamp += fromSeconds(period);
    noisy.covariance = isotropic(0.3);
    noisy.acceleration_covariance = Eigen::Vector3d(1.0, 4.0, 9.0).asDiagonal();
    imu.reach(noisy);
    EXPECT_LT(distance(imu.gyroNoise({}), isotropic(0.01) / period), 1e-12);
    const ImuInterval over = imu.over(noisy.stamp, noisy.stamp + fromSeconds(0.5 * period));
    EXPECT_LT(distance(over.rate_density, period * isotropic(0.3)), 1e-12);
    EXPECT_LT(distance(over.acceleration_density, period * *noisy.acceleration_covariance), 1e-12);
    EXPECT_EQ(imu.gyroNoise(noisy), isotropic(0.3));
  }
  // Without one the configured density holds.
  EXPECT_LT(
      distance(growing(false).over(fromSeconds(10.0), fromSeconds(10.01)).rate_density, isotropic(0.01)),
      1e-15);
}

// A frame is looked at before the next sample where that comes late: held beyond its turn the last one is not
// what it is.
TEST(ImuTrack, ASampleThatIsMissedMakesTheRateUncertain) {
  ImuTrack imu(kNoise, true);
  for (const double t : {10.0, 10.01})
    imu.reach(imuSample(t, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()));
  const auto density = [&imu](double to) {
    return imu.over(fromSeconds(10.01), fromSeconds(to)).rate_density(0, 0);
  };
  EXPECT_EQ(density(10.02), 1e-4);
  EXPECT_NEAR(density(10.06) - 1e-4, 2.5e-3, 1e-9);
}

// An IMU of 10 Hz is slow, and one that is silent for longer has lost samples.
TEST(ImuTrack, AGapIsUncertainByWhatTheBodyMayHaveDoneInIt) {
  const auto density = [](double gap) {
    return growing(true, 10.0 + gap).over(fromSeconds(10.0), fromSeconds(10.0 + gap)).rate_density(0, 0);
  };
  EXPECT_EQ(density(0.1), 1e-4);
  EXPECT_GT(density(0.2), 1e-3);
  EXPECT_NEAR((density(0.8) - 1e-4) / (density(0.4) - 1e-4), 4.0, 1e-9);
  // Where no sample ends it, twelve times as much.
  ImuTrack open(kNoise, true);
  open.reach(imuSample(10.0, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()));
  const ImuInterval over = open.over(fromSeconds(10.0), fromSeconds(10.4));
  EXPECT_NEAR(over.rate_density(1, 1) - 1e-4, 12.0 * (density(0.4) - 1e-4), 1e-9);
  EXPECT_GT(over.acceleration_density(0, 0), over.rate_density(0, 0));
  // As much where no sample begins it.
  ImuTrack late(kNoise, true);
  late.expect(imuSample(10.4, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()));
  EXPECT_NEAR(late.over(fromSeconds(10.0), fromSeconds(10.1)).rate_density(1, 1), over.rate_density(1, 1),
              1e-9);
  EXPECT_GT(ImuTrack(kNoise, true).over(fromSeconds(10.0), fromSeconds(10.1)).rate_density(1, 1),
            over.rate_density(1, 1))
      << "and more without any";
  // As if it were known that one ends it.
  open.expectAt(fromSeconds(10.4));
  EXPECT_EQ(open.over(fromSeconds(10.0), fromSeconds(10.4)).rate_density(1, 1), density(0.4));
  // A gap does not count as the IMU's period.
  ImuTrack imu = growing();
  imu.reach(imuSample(12.0, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()));
  EXPECT_GE(imu.gyroNoise()(0, 0), 1e-4 / 0.151);
}

/// Density added to the rate's in the last of these intervals (s), which come again and again before it.
double addedIn(double gap, const std::vector<double>& intervals) {
  ImuTrack imu(kNoise, true);
  const auto still = [](double t) { return imuSample(t, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()); };
  double t = 10.0;
  for (std::size_t i = 0; i < 60; t += intervals[i++ % intervals.size()]) imu.reach(still(t));
  const Stamp last = fromSeconds(t - intervals.back()), next = fromSeconds(t - intervals.back() + gap);
  ImuSample sample = still(t);
  sample.stamp = next;
  imu.expect(sample);
  return imu.over(last, next).rate_density(0, 0) - 1e-4;
}

TEST(ImuTrack, SamplesThatAFastImuLosesAreAGapToo) {
  EXPECT_NEAR(addedIn(0.1, {0.005}), 0.1 * 0.1 / 12.0, 1e-8);
  EXPECT_NEAR(addedIn(0.03, {0.005}), 0.03 * 0.03 / 12.0, 1e-8);
  EXPECT_EQ(addedIn(0.01, {0.005}), 0.0) << "one of them";
  EXPECT_EQ(addedIn(0.1, {0.1}), 0.0) << "as slow as that";
  EXPECT_EQ(addedIn(0.0148, {0.0001, 0.0001, 0.0148}), 0.0) << "stamps of a host";
}

} // namespace
} // namespace vi_ekf_slam
