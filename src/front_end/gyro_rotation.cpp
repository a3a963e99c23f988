#include "vi_ekf_slam/front_end/gyro_rotation.hpp"

#include <algorithm>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {

namespace {
constexpr double kGyroJump = 1.0;          // s back: time begins anew
constexpr std::size_t kMaxSamples = 20000; // 10 s at 2 kHz; what nobody asks for must not pile up
} // namespace

void GyroRotation::add(const ImuSample& sample) {
  if (!sample.angular_velocity.allFinite()) return;
  if (!samples_.empty() && sample.stamp <= samples_.back().stamp) {
    if (secondsBetween(sample.stamp, samples_.back().stamp) < kGyroJump) return;
    samples_.clear();
  }
  samples_.push_back({sample.stamp, sample.angular_velocity});
  if (samples_.size() > kMaxSamples) samples_.pop_front();
}

void GyroRotation::forgetBefore(Stamp stamp) {
  while (samples_.size() >= 2 && samples_[1].stamp <= stamp) samples_.pop_front();
}

Eigen::Vector3d GyroRotation::rateAt(Stamp stamp) const {
  const auto after = std::lower_bound(samples_.begin(), samples_.end(), stamp,
                                      [](const Sample& s, Stamp t) { return s.stamp < t; });
  if (after->stamp == stamp || after == samples_.begin()) return after->rate;
  const auto before = after - 1;
  const double share = secondsBetween(before->stamp, stamp) / secondsBetween(before->stamp, after->stamp);
  return (1.0 - share) * before->rate + share * after->rate;
}

std::optional<Eigen::Matrix3d> GyroRotation::between(Stamp from, Stamp to) const {
  if (samples_.empty() || from > to || from < samples_.front().stamp || to > samples_.back().stamp)
    return std::nullopt;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Stamp t = from;
  Eigen::Vector3d rate = rateAt(from);
  const auto step = [&](Stamp next, const Eigen::Vector3d& next_rate) {
    rotation = rotation * so3::Exp(0.5 * secondsBetween(t, next) * (rate + next_rate));
    t = next;
    rate = next_rate;
  };
  for (const Sample& sample : samples_) {
    if (sample.stamp > from && sample.stamp < to) step(sample.stamp, sample.rate);
  }
  step(to, rateAt(to));
  return rotation;
}

} // namespace vi_ekf_slam
