#include "vi_ekf_slam/ros/input/feature_screen.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_set>
#include <utility>
#include <vector>

namespace vi_ekf_slam {
namespace {

constexpr double kMargin = 1.0;   // px
constexpr double kMaxPixel = 1e6; // px, where the size of the image is not known

bool isInside(const StereoPixels& z, const ImageSize& image) {
  const auto inside = [](double x, double size) { return x >= -kMargin && x <= size - 1.0 + kMargin; };
  return inside(z[0], image.width) && inside(z[2], image.width) && inside(z[1], image.height) &&
         inside(z[3], image.height);
}

/// The finaliser of splitmix64: neighbouring ids get unrelated values.
std::uint64_t hash(std::uint64_t x) {
  x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27U)) * 0x94d049bb133111ebU;
  return x ^ (x >> 31U);
}

void keepSubset(std::vector<StereoFeatureObservation>& features, std::size_t count) {
  std::vector<std::pair<std::uint64_t, FeatureId>> order;
  order.reserve(features.size());
  for (const auto& f : features) order.emplace_back(hash(f.id), f.id);
  std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), order.end());
  std::unordered_set<FeatureId> kept;
  for (std::size_t i = 0; i < count; ++i) kept.insert(order[i].second);
  const auto surplus = [&kept](const auto& f) { return kept.count(f.id) == 0; };
  features.erase(std::remove_if(features.begin(), features.end(), surplus), features.end());
}

} // namespace

ScreenCounts screenFeatures(StereoFrame& frame, const std::optional<ImageSize>& image,
                            std::size_t max_features) {
  ScreenCounts counts;
  const auto unusable = [&](const StereoFeatureObservation& feature) {
    const StereoPixels& z = feature.pixels;
    std::size_t* reason = nullptr;
    if (!z.allFinite() || !std::isfinite(feature.sigma) || !std::isfinite(feature.walk)) {
      reason = &counts.not_finite;
    } else if (z.cwiseAbs().maxCoeff() > kMaxPixel || feature.sigma < 0.0 || feature.walk < 0.0 ||
               (image && z[0] - z[2] >= image->width)) {
      reason = &counts.absurd;
    } else if (image && !isInside(z, *image)) {
      reason = &counts.outside;
    } else {
      counts.no_disparity += z[0] - z[2] > 0.0 ? 0 : 1;
      return false;
    }
    ++*reason;
    return true;
  };
  auto& features = frame.features;
  features.erase(std::remove_if(features.begin(), features.end(), unusable), features.end());
  if (features.size() > max_features) {
    counts.surplus = features.size() - max_features;
    keepSubset(features, max_features);
  }
  return counts;
}

} // namespace vi_ekf_slam
