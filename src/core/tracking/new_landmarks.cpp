#include "vi_ekf_slam/core/tracking/new_landmarks.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <utility>

namespace vi_ekf_slam {
namespace {

// Of the spacing of `most` points that fill a picture about the principal point evenly. Recorded drives and
// simulated streams do as well with 0.3 to 0.8; the smoothed path of drawn streets had 33, 36, 41 to 43 and
// 33 mm with 0.3, 0.4, 0.5 and 0.8, where equal runs differ by 3 (docs/inertial.md).
constexpr double kClear = 0.3;

Eigen::Vector2d pixel(const StereoFrame& frame, std::size_t feature) {
  const StereoPixels& z = frame.features[feature].pixels;
  return {0.5 * (z[0] + z[2]), z[1]};
}

/// Where the features are that are landmarks in view.
std::vector<Eigen::Vector2d> inView(const StereoFrame& frame, const LandmarkMap& map) {
  const auto index = map.indexById();
  std::vector<Eigen::Vector2d> pixels;
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const auto found = index.find(frame.features[i].id);
    if (found == index.end()) continue;
    const Landmark& landmark = map.active()[found->second];
    if (landmark.last_seen == frame.stamp && !landmark.reactivated) pixels.push_back(pixel(frame, i));
  }
  return pixels;
}

} // namespace

std::vector<std::size_t> chooseNewLandmarks(const StereoFrame& frame, const StereoCamera& camera,
                                            const LandmarkMap& map, std::vector<std::size_t> features,
                                            std::size_t most) {
  std::vector<Eigen::Vector2d> taken = inView(frame, map);
  const std::size_t room = most > taken.size() ? most - taken.size() : 0;
  if (room == 0) return {};
  if (features.size() <= room) return features;
  const Eigen::Vector2d middle(camera.cu, camera.cv);
  const auto order = [&](std::size_t feature) {
    return std::make_pair((pixel(frame, feature) - middle).norm(), frame.features[feature].id);
  };
  std::sort(features.begin(), features.end(),
            [&](std::size_t a, std::size_t b) { return order(a) < order(b); });
  const double clear = kClear * std::sqrt(4.0 * std::abs(camera.cu * camera.cv) / static_cast<double>(most));
  std::vector<std::size_t> chosen, crowded;
  for (const std::size_t feature : features) {
    const Eigen::Vector2d at = pixel(frame, feature);
    const bool is_clear = std::all_of(taken.begin(), taken.end(), [&](const Eigen::Vector2d& other) {
      return (at - other).norm() > clear;
    });
    (is_clear ? chosen : crowded).push_back(feature);
    if (is_clear) taken.push_back(at);
    if (chosen.size() == room) return chosen;
  }
  crowded.resize(room - chosen.size());
  chosen.insert(chosen.end(), crowded.begin(), crowded.end());
  return chosen;
}

} // namespace vi_ekf_slam
