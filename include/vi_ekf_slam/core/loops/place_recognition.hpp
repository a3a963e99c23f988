#pragma once

#include <cstdint>

namespace vi_ekf_slam {

/// How places are recognised where ids do not return.
enum class PlaceRecognition : std::uint8_t {
  kNone,
  kDescriptors,   ///< by what landmarks look like, where features come with descriptors
  kConstellation, ///< by their constellation too
};

} // namespace vi_ekf_slam
