#include "vi_ekf_slam/core/sensors/imu_check.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "vi_ekf_slam/core/sensors/median.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kWindow = 100; // intervals
constexpr std::size_t kFewest = 20;  // intervals that tell which one is usual
constexpr double kFactor = 1.5;      // a lost sample makes 2 of it
constexpr std::size_t kStuttering = kWindow / 10;
constexpr double kHoles = 0.25;  // of the time, in which samples come together or are lost
constexpr double kSilence = 0.5; // s, and longer than some samples of a slow one
constexpr std::size_t kFramesAlone = 3;
constexpr double kAccelerationTime = 1;     // s over which accelerations are judged
constexpr double kLeast = 0.3, kMost = 3.0; // of gravity, their mean norm
constexpr double kMaxRate = 70.0;           // rad/s: gyros end at 4000 deg/s
constexpr double kLeastInG = 0.7, kMostInG = 1.4;

} // namespace

std::string ImuCheck::problem() const {
  std::string all;
  for (const std::string& fault : faults_) addProblem(all, fault);
  return all;
}

void ImuCheck::restart() {
  arrived_.reset();
  last_.reset();
  frames_alone_ = 0;
  first_.reset();
  intervals_.clear();
  odd_.clear();
  faults_[kStopped].clear();
}

void ImuCheck::arrived(Stamp stamp) {
  if (arrived_ && stamp < *arrived_) {
    if (counts_.backwards++ == 0)
      say("the IMU's stamps go back by " + rounded(secondsBetween(stamp, *arrived_)) +
          " s: each must be later than the one before");
  }
  arrived_ = stamp;
}

void ImuCheck::noteInterval(Stamp from, Stamp to) {
  const double interval = secondsBetween(from, to);
  const double usual = intervals_.size() < kFewest ? interval : medianOf(intervals_);
  const bool is_gap = interval > std::max(kSilence, 5.0 * usual);
  if (is_gap) return;
  const bool is_odd = interval > kFactor * usual || usual > kFactor * interval;
  if (is_odd) ++counts_.stutters;
  intervals_.push_back(interval);
  odd_.push_back(is_odd);
  if (intervals_.size() > kWindow) {
    intervals_.pop_front();
    odd_.pop_front();
  }
  const double odd_time = std::inner_product(intervals_.begin(), intervals_.end(), odd_.begin(), 0.0);
  const double time = std::accumulate(intervals_.begin(), intervals_.end(), 0.0);
  if (std::count(odd_.begin(), odd_.end(), true) <= static_cast<std::ptrdiff_t>(kStuttering) &&
      odd_time <= kHoles * time)
    return faults_[kStutter].clear();
  const auto [shortest, longest] = std::minmax_element(intervals_.begin(), intervals_.end());
  faults_[kStutter] =
      "the IMU stutters: its samples are " + rounded(1e3 * *shortest) + " to " + rounded(1e3 * *longest) +
      " ms apart, mostly " + rounded(1e3 * usual) +
      "; more than one in ten, or a quarter of the time, differs from that by more than a factor of " +
      rounded(kFactor);
  if (!std::exchange(told_stutter_, true)) say(faults_[kStutter]);
}

/// A hand or a car turns by more than 70 deg/s soon.
void ImuCheck::noteRate(const ImuSample& sample) {
  const double rate = sample.angular_velocity.cwiseAbs().maxCoeff();
  if (rate <= kMaxRate || ++impossible_ != kFewest) return;
  find(kRate, "the gyro's rates are up to " + rounded(rate) + " rad/s, allowed: " + rounded(kMaxRate) +
                  " rad/s; is it in deg/s? it must be in rad/s");
}

void ImuCheck::noteRange(Fault fault, const Eigen::Vector3d& value) {
  const bool is_gyro = fault == kGyroRange;
  std::array<Saturation, 3>& axes = is_gyro ? gyro_axes_ : accelerometer_axes_;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    Saturation& saturation = axes[static_cast<std::size_t>(axis)];
    if (!saturation.note(value[axis]) || !faults_[fault].empty()) continue;
    find(fault, std::string("the ") + (is_gyro ? "gyro" : "accelerometer") + " is saturated at " +
                    rounded(saturation.limit()) + (is_gyro ? " rad/s" : " m/s^2") + " (its " + "xyz"[axis] +
                    " axis), where its values are cut off; set a larger range in the IMU's driver, or move " +
                    (is_gyro ? "more slowly" : "and mount it more softly"));
  }
}

/// The mean norm: at rest it is gravity, and no motion takes it away for as long.
void ImuCheck::noteAcceleration(const ImuSample& sample) {
  ++samples_;
  if (sample.acceleration) {
    ++accelerated_;
    norms_ += sample.acceleration->norm();
  }
  if (samples_ < kFewest || secondsBetween(*first_, sample.stamp) < kAccelerationTime) return;
  accelerations_judged_ = true;
  if (const std::string problem = accelerationProblem(); !problem.empty()) find(kAcceleration, problem);
}

std::string ImuCheck::accelerationProblem() const {
  if (accelerated_ == 0)
    return "the IMU's messages carry no acceleration (all are 0, or said not to be measured), which motion: "
           "inertial needs";
  const double norm = norms_ / static_cast<double>(accelerated_);
  if (norm >= kLeast * gravity_ && norm <= kMost * gravity_) return {};
  const bool is_in_g = norm >= kLeastInG && norm <= kMostInG;
  const std::string cause =
      is_in_g           ? "are they in g? they must be in m/s^2"
      : norm < gravity_ ? "gravity is missing: accelerations must be those that an accelerometer reads, with "
                          "gravity, not compensated for it"
                        : "are they in another unit? they must be in m/s^2";
  return "the IMU's accelerations have a mean of " + rounded(norm) + " over " + rounded(kAccelerationTime) +
         " s, allowed: " + rounded(kLeast * gravity_) + " to " + rounded(kMost * gravity_) + " m/s^2; " +
         cause;
}

void ImuCheck::note(const ImuSample& sample, bool inertial) {
  if (last_ && sample.stamp > *last_) noteInterval(*last_, sample.stamp);
  last_ = sample.stamp;
  frames_alone_ = 0;
  if (!first_) first_ = sample.stamp;
  noteRate(sample);
  noteRange(kGyroRange, sample.angular_velocity);
  if (inertial && sample.acceleration) noteRange(kAccelerometerRange, *sample.acceleration);
  if (inertial && !accelerations_judged_) noteAcceleration(sample);
  if (faults_[kStopped].empty()) return;
  faults_[kStopped].clear();
  say("the IMU is back");
}

/// One frame right after the last sample and one right before the next are a gap of both.
void ImuCheck::noteFrame(Stamp stamp) {
  if (!last_ || !faults_[kStopped].empty() || ++frames_alone_ < kFramesAlone) return;
  const double usual = intervals_.empty() ? 0.0 : medianOf(intervals_);
  const double silence = secondsBetween(*last_, stamp);
  if (silence <= std::max(kSilence, 5.0 * usual)) return;
  ++counts_.stops;
  const bool is_late = arrived_ && *arrived_ > *last_ && *arrived_ < stamp;
  find(
      kStopped,
      (is_late ? "the IMU's samples come after frames that are " + rounded(secondsBetween(*arrived_, stamp)) +
                     " s newer, too late to be used (buffer/max_delay_s; do camera and IMU have one clock?)"
               : "the IMU has stopped: no sample for " + rounded(silence) + " s, while frames go on") +
          "; the estimate goes on with a growing covariance");
}

} // namespace vi_ekf_slam
