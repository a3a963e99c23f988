#include "vi_ekf_slam/front_end/track.hpp"

#include <cmath>
#include <utility>

namespace vi_ekf_slam {
namespace {

constexpr double kMinLikeness = 0.9;
// px, as kByFlow: where the anchor is cut from the image before, 0.32 and 0.19.
constexpr double kByNewAnchor = 0.25;

/// Whether the anchor looks like what is there.
bool align(const AnchorPatch& anchor, AnchorPatch::Warp start, const cv::Mat& image,
           const TrackPrediction& prediction, float reach, Track& track) {
  start.centre = {prediction.pixel.x, prediction.pixel.y};
  start.shape *= prediction.magnification;
  const auto fit = anchor.align(image, start);
  if (!fit || fit->correlation < kMinLikeness) return false;
  if ((fit->warp.centre - start.centre).norm() > reach) return false;
  track.left = {fit->warp.centre.x(), fit->warp.centre.y()};
  track.warp = fit->warp;
  return true;
}

} // namespace

bool alignTrack(const cv::Mat& before, const cv::Mat& now, const TrackPrediction& prediction, float reach,
                Track& track) {
  if (track.anchor && align(*track.anchor, track.warp, now, prediction, reach, track)) return true;
  auto anchor = AnchorPatch::cut(before, track.left);
  if (!anchor || !align(*anchor, {}, now, prediction, reach, track)) return false;
  track.anchor = std::move(anchor);
  track.strayed = std::hypot(track.strayed, kByNewAnchor);
  return true;
}

void anchorAnew(const cv::Mat& now, const cv::Point2f& pixel, Track& track) {
  track.left = pixel;
  track.anchor = AnchorPatch::cut(now, pixel);
  track.warp = {};
  track.strayed = std::hypot(track.strayed, kByFlow);
}

} // namespace vi_ekf_slam
