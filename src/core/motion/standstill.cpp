#include "vi_ekf_slam/core/motion/standstill.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "vi_ekf_slam/core/sensors/median.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kWindow = 1.0;           // s
constexpr double kLeastSpan = 0.8;        // of the window that samples must cover
constexpr std::size_t kLeastSamples = 5;  // of each sensor in the window
constexpr double kFlowTime = 0.08;        // s at least, over which the motion of tracks is looked at
constexpr double kSigmas = 3.0;           // the mean may be off zero
constexpr std::size_t kLeastTracks = 5;   // shared by two frames, for their motion to count
constexpr std::size_t kLeastFlows = 5;    // in the window, for the picture to count
constexpr double kTellingVelocity = 0.05; // m/s: a mean better than this tells by itself
constexpr double kSlowest = 0.15;         // m/s: what such a mean may be at most

template <typename T>
void forgetBefore(std::deque<T>& items, Stamp stamp) {
  while (!items.empty() && secondsBetween(items.front().stamp, stamp) > kWindow) items.pop_front();
}

} // namespace

void StandstillDetector::addVelocity(Stamp stamp, const Eigen::Vector3d& velocity,
                                     const Eigen::Matrix3d& covariance) {
  velocities_.push_back({stamp, velocity, covariance.diagonal()});
  forgetBefore(velocities_, stamp);
}

void StandstillDetector::addGyro(Stamp stamp, const Eigen::Vector3d& rate, const Eigen::Matrix3d& covariance,
                                 const Eigen::Matrix3d& bias_covariance) {
  rates_.push_back({stamp, rate, covariance.diagonal()});
  bias_variance_ = bias_covariance.diagonal();
  forgetBefore(rates_, stamp);
}

void StandstillDetector::addFrame(const StereoFrame& frame) {
  if (!last_.empty() && secondsBetween(last_stamp_, frame.stamp) < kFlowTime) return;
  std::vector<double> motions;
  std::vector<StereoFeatureObservation> now = frame.features;
  const auto byId = [](const auto& a, const auto& b) { return a.id < b.id; };
  std::sort(now.begin(), now.end(), byId);
  for (const StereoFeatureObservation& feature : now) {
    const auto before = std::lower_bound(last_.begin(), last_.end(), feature, byId);
    if (before == last_.end() || before->id != feature.id) continue;
    const StereoPixels motion = feature.pixels - before->pixels;
    if (motion.allFinite()) motions.push_back(motion.head<2>().norm());
  }
  last_.swap(now);
  last_stamp_ = frame.stamp;
  if (motions.size() >= kLeastTracks) flows_.push_back({frame.stamp, medianOf(std::move(motions))});
  forgetBefore(flows_, frame.stamp);
}

bool StandstillDetector::stands(Stamp now) const {
  const bool has_velocity = coversWindow(velocities_, now);
  if ((!has_velocity && needs_velocity_) || !coversWindow(rates_, now)) return false;
  if (has_velocity && !agreesWithZero(velocities_, Eigen::Vector3d::Zero())) return false;
  if (!agreesWithZero(rates_, bias_variance_)) return false;
  const Picture seen = picture(now);
  if (seen != Picture::kUnknown || !has_velocity) return seen == Picture::kStill;
  const Mean velocity = meanOf(velocities_);
  return std::sqrt(velocity.variance.maxCoeff()) < kTellingVelocity && velocity.value.norm() < kSlowest;
}

bool StandstillDetector::coversWindow(const std::deque<Sample>& samples, Stamp now) {
  return samples.size() >= kLeastSamples &&
         secondsBetween(samples.front().stamp, samples.back().stamp) >= kLeastSpan * kWindow &&
         secondsBetween(samples.back().stamp, now) <= kWindow - kLeastSpan;
}

bool StandstillDetector::agreesWithZero(const std::deque<Sample>& samples,
                                        const Eigen::Vector3d& bias_variance) {
  const Mean mean = meanOf(samples);
  const Eigen::Vector3d variance = mean.variance + bias_variance;
  return (mean.value.array().square() <= kSigmas * kSigmas * variance.array()).all();
}

StandstillDetector::Mean StandstillDetector::meanOf(const std::deque<Sample>& samples) {
  Mean mean;
  for (const Sample& s : samples) {
    mean.value += s.value;
    mean.variance += s.variance;
  }
  const auto count = static_cast<double>(samples.size());
  mean.value /= count;
  mean.variance /= count * count;
  return mean;
}

StandstillDetector::Picture StandstillDetector::picture(Stamp now) const {
  if (flows_.size() < kLeastFlows || secondsBetween(flows_.back().stamp, now) > kWindow - kLeastSpan)
    return Picture::kUnknown;
  const bool still =
      std::all_of(flows_.begin(), flows_.end(), [this](const Flow& f) { return f.median <= still_px_; });
  return still ? Picture::kStill : Picture::kMoving;
}

} // namespace vi_ekf_slam
