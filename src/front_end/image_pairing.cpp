#include "vi_ekf_slam/front_end/image_pairing.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace vi_ekf_slam {
namespace {

constexpr double kPairingJump = 1.0;    // s back: time begins anew
constexpr std::size_t kMaxQueue = 1000; // images; what never finds a partner must not fill the memory
constexpr double kUnknown = std::numeric_limits<double>::infinity();

} // namespace

void ImagePairing::add(PendingImage image, Camera& camera) {
  if (image.stamp == 0) {
    ++counts_.without_stamp;
    return;
  }
  double since = camera.last ? secondsBetween(*camera.last, image.stamp) : kUnknown;
  if (camera.last && image.stamp <= *camera.last) {
    if (secondsBetween(image.stamp, *camera.last) < kPairingJump) {
      ++counts_.disordered;
      return;
    }
    counts_.*camera.alone += camera.waiting.size();
    camera.waiting.clear();
    since = kUnknown;
    // Of the time that was left no gyro comes any more, for which all that follow would wait.
    while (!pairs_.empty() && pairs_.back().left.stamp > image.stamp && lacksSomething(pairs_.back())) {
      pairs_.pop_back();
      ++counts_.shed;
    }
  }
  camera.last = image.stamp;
  if (image.stamp > newest_ || secondsBetween(image.stamp, newest_) > kPairingJump) newest_ = image.stamp;
  camera.waiting.push_back({std::move(image), since});
  pairUp();
  const auto& waiting = camera.waiting;
  while (!waiting.empty() && (waiting.size() > kMaxQueue ||
                              secondsBetween(waiting.front().image.stamp, newest_) > options_.max_wait_s)) {
    dropOldest(camera);
  }
}

void ImagePairing::dropOldest(Camera& camera) {
  camera.waiting.pop_front();
  ++(counts_.*camera.alone);
}

void ImagePairing::noteGyro(Stamp stamp) {
  if (!gyro_) gyro_expected_ = true;
  if (!gyro_ || stamp > *gyro_ || secondsBetween(stamp, *gyro_) > kPairingJump) gyro_ = stamp;
}

void ImagePairing::pairUp() {
  auto &left = left_.waiting, &right = right_.waiting;
  while (!left.empty() && !right.empty()) {
    const double apart = secondsBetween(left.front().image.stamp, right.front().image.stamp);
    const double nearest = 0.5 * std::min(left.front().since, right.front().since);
    if (std::abs(apart) <= std::min(options_.tolerance_s, nearest)) {
      pairs_.push_back({std::move(left.front().image), std::move(right.front().image)});
      left.pop_front();
      right.pop_front();
    } else {
      dropOldest(apart > 0.0 ? left_ : right_); // all that follow of the other one are later still
    }
  }
  while (pairs_.size() > kMaxQueue) {
    pairs_.pop_front();
    ++counts_.shed;
  }
}

bool ImagePairing::lacksSomething(const PendingPair& pair) const {
  const bool lacks_gyro = gyro_expected_ && !(gyro_ && *gyro_ >= pair.left.stamp);
  return is_held_ || lacks_gyro;
}

bool ImagePairing::isReady(const PendingPair& pair) {
  if (is_closed_ || !lacksSomething(pair)) return true;
  if (secondsBetween(pair.left.stamp, newest_) <= options_.max_wait_s) return false;
  if (!is_held_) {
    ++counts_.without_gyro;
    gyro_expected_ = gyro_.has_value(); // one from which nothing comes is not waited for again
  }
  return true;
}

std::optional<PendingPair> ImagePairing::pop() {
  if (pairs_.empty() || !isReady(pairs_.front())) return std::nullopt;
  PendingPair pair = std::move(pairs_.front());
  pairs_.pop_front();
  return pair;
}

std::optional<PendingPair> ImagePairing::popNewest() {
  std::optional<PendingPair> newest;
  while (auto pair = pop()) {
    if (newest) ++counts_.shed;
    newest = std::move(pair);
  }
  return newest;
}

} // namespace vi_ekf_slam
