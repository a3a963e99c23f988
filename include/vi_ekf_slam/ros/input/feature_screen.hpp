#pragma once

#include <cstddef>
#include <optional>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// px, of both rectified images.
struct ImageSize {
  double width = 0.0;
  double height = 0.0;
};

/// What became of the features of one message.
struct ScreenCounts {
  std::size_t not_finite = 0; ///< removed
  std::size_t outside = 0;    ///< removed: a pixel outside its image
  std::size_t absurd = 0;     ///< removed: a disparity as large as the image is wide, or a pixel beyond 1e6
  std::size_t surplus = 0;    ///< removed: more than are taken of one message
  std::size_t no_disparity =
      0; ///< kept: it has no depth, but its motion shows whether the camera stands still
};

/// Removes the features that nobody can use, one by one, and leaves at most `max_features`. Those are chosen
/// by a hash of their ids: spread over the image, and the same tracks from one frame to the next.
/// `image`: of the camera_info, if it says; a pixel may be 1 px outside, which noise is.
ScreenCounts screenFeatures(StereoFrame& frame, const std::optional<ImageSize>& image,
                            std::size_t max_features);

} // namespace vi_ekf_slam
