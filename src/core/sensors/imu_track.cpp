#include "vi_ekf_slam/core/sensors/imu_track.hpp"

#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam {
namespace {

// s; no IMU is as slow. What comes after it, or after so many mean intervals (stamps of a host come in
// bursts), is a gap, in which rate and acceleration do what they like:
constexpr double kLongestPeriod = 0.15;
constexpr double kMissing = 4.0;
constexpr double kUsual = 20.0;            // intervals, of which that is the mean, and
constexpr double kFewestIntervals = 5.0;   // that it takes
constexpr double kRateWalk = 1.0;          // rad/s^1.5, of a vehicle or a hand that is not seen
constexpr double kAccelerationWalk = 10.0; // m/s^2.5
constexpr double kMemory = 1.0;            // s, of how much the body shakes
constexpr double kLeastDifferences = 5.0;  // to say so
constexpr double kClearly = 2.0;           // times the noise that is stated; less is chance
constexpr double kWithoutAny = 1.0;        // s from a sample, where there is none at all
constexpr double kLate = 1.5;              // periods, after which the next sample is missed
// From one interval to the next: a parabola multiplies the noise of a shorter one (stamps of a host come in
// bursts).
constexpr double kRegular = 2.0;

} // namespace

/// Where it has no acceleration, unlike those before (a message that lacks it, an accelerometer that fails),
/// with the last one that was measured.
ImuSample ImuTrack::completed(ImuSample sample) const {
  if (!sample.acceleration && last_) {
    sample.acceleration = last_->acceleration;
    sample.acceleration_covariance = last_->acceleration_covariance;
  }
  return sample;
}

void ImuTrack::expect(const ImuSample& next) { next_ = completed(next); }

void ImuTrack::expectAt(Stamp stamp) {
  const auto& one = next_ ? next_ : last_;
  if (!one) return;
  ImuSample there = *one;
  there.stamp = stamp;
  next_ = there;
}

void ImuTrack::reach(const ImuSample& measured) {
  if (measured.acceleration) accelerated_ = measured.stamp;
  const ImuSample sample = completed(measured);
  if (last_ && sample.stamp > last_->stamp) {
    period_ = std::min(secondsBetween(last_->stamp, sample.stamp), kLongestPeriod);
    intervals_ = std::min(intervals_ + 1.0, kUsual);
    usual_ += (period_ - usual_) / intervals_;
  }
  noteDifferences(sample);
  before_ = std::exchange(last_, sample);
  next_.reset();
}

void ImuTrack::noteDifferences(const ImuSample& sample) {
  const double since = last_ ? secondsBetween(last_->stamp, sample.stamp) : 0.0;
  if (since <= 0.0 || since > longestInterval()) recent_.clear();
  recent_.push_back({sample.angular_velocity, sample.acceleration.value_or(Eigen::Vector3d::Zero())});
  if (recent_.size() < 5) return;
  const auto variance = [this](auto member) -> Eigen::Vector3d {
    const Eigen::Vector3d fourth = recent_[0].*member - 4.0 * recent_[1].*member + 6.0 * recent_[2].*member -
                                   4.0 * recent_[3].*member + recent_[4].*member;
    return fourth.cwiseAbs2() / 70.0;
  };
  weight_ = std::min(weight_ + 1.0, std::max(kMemory / since, 5.0));
  shaking_.rate += (variance(&Reading::rate) - shaking_.rate) / weight_;
  shaking_.acceleration += (variance(&Reading::acceleration) - shaking_.acceleration) / weight_;
  recent_.pop_front();
}

double ImuTrack::longestInterval() const {
  return intervals_ < kFewestIntervals ? kLongestPeriod : std::min(kMissing * usual_, kLongestPeriod);
}

ImuTrack::Reading ImuTrack::at(Stamp stamp) const {
  const auto& one = last_ ? last_ : next_;
  if (!one) return {};
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  const Reading first{one->angular_velocity, one->acceleration.value_or(none)};
  if (!last_ || !next_ || next_->stamp <= last_->stamp) return first;
  const double s =
      std::clamp(secondsBetween(last_->stamp, stamp) / secondsBetween(last_->stamp, next_->stamp), 0.0, 1.0);
  return {(1.0 - s) * first.rate + s * next_->angular_velocity,
          (1.0 - s) * first.acceleration + s * next_->acceleration.value_or(none)};
}

/// What the parabola is off the straight line, in the mean over [from, to]: with the last sample at 0 and the
/// next at h it is c s (s - h), of the second divided difference c.
ImuTrack::Reading ImuTrack::bend(Stamp from, Stamp to) const {
  if (!before_ || !last_ || !next_ || from >= to) return {};
  const double h = secondsBetween(last_->stamp, next_->stamp),
               g = secondsBetween(before_->stamp, last_->stamp);
  if (!(h > 0.0 && g > 0.0 && std::max(g, h) <= kLongestPeriod &&
        std::max(g, h) <= kRegular * std::min(g, h)))
    return {};
  const auto integral = [h](double s) { return s * s * (s / 3.0 - h / 2.0); };
  const double begin = secondsBetween(last_->stamp, from), end = secondsBetween(last_->stamp, to);
  const double mean = (integral(end) - integral(begin)) / (end - begin);
  const auto bendOf = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                          const Eigen::Vector3d& c) -> Eigen::Vector3d {
    return mean / (g + h) * ((c - b) / h - (b - a) / g);
  };
  Reading result;
  result.rate = bendOf(before_->angular_velocity, last_->angular_velocity, next_->angular_velocity);
  if (before_->acceleration && last_->acceleration && next_->acceleration)
    result.acceleration = bendOf(*before_->acceleration, *last_->acceleration, *next_->acceleration);
  return result;
}

Eigen::Vector3d ImuTrack::rateAt(Stamp stamp) const { return at(stamp).rate; }

Eigen::Matrix3d ImuTrack::gyroNoise(const ImuSample& sample) const {
  if (!noise_given_ && sample.covariance) return *sample.covariance;
  return isotropic(noise_.gyro_density) / period_;
}

/// A sample's noise holds for a period: its density is the covariance times that. In a gap of T s between two
/// samples what walks ends where the second one is: over the gap it is off by walk^2 T^3 / 12; without a
/// second one, T s after the last, or without a first one, T s before the next, it grows by walk^2 T^2.
ImuInterval ImuTrack::over(Stamp from, Stamp to) const {
  const Reading a = at(from), b = at(to), bent = bend(from, to);
  ImuInterval interval{0.5 * (a.rate + b.rate) + bent.rate,
                       0.5 * (a.acceleration + b.acceleration) + bent.acceleration,
                       b.rate - a.rate,
                       b.acceleration - a.acceleration,
                       isotropic(noise_.gyro_density),
                       isotropic(noise_.accelerometer_density)};
  if (!noise_given_ && last_ && last_->covariance) interval.rate_density = period_ * *last_->covariance;
  if (!noise_given_ && last_ && last_->acceleration_covariance)
    interval.acceleration_density = period_ * *last_->acceleration_covariance;
  if (weight_ >= kLeastDifferences) {
    for (Eigen::Index i = 0; i < 3; ++i) {
      const auto raise = [&](Eigen::Matrix3d& density, double variance) {
        if (variance * period_ > kClearly * density(i, i)) density(i, i) = variance * period_;
      };
      raise(interval.rate_density, shaking_.rate[i]);
      raise(interval.acceleration_density, shaking_.acceleration[i]);
    }
  }
  double gap = kWithoutAny;
  if (last_ || next_) gap = secondsBetween(last_ ? last_->stamp : from, next_ ? next_->stamp : to);
  const bool between = last_ && next_;
  if (gap > (between ? longestInterval() : kLate * period_)) {
    const double growth = between ? gap * gap / 12.0 : gap * gap;
    interval.rate_density += growth * isotropic(kRateWalk);
    interval.acceleration_density += growth * isotropic(kAccelerationWalk);
  }
  const double held = accelerated_ ? secondsBetween(*accelerated_, to) : 0.0;
  if (held > kLongestPeriod && gap <= kLongestPeriod)
    interval.acceleration_density += held * held * isotropic(kAccelerationWalk);
  return interval;
}

} // namespace vi_ekf_slam
