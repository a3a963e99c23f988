#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// In how many of the 256 bits two descriptors differ: about 128 of two points that have nothing in common.
int hammingDistance(const Descriptor& a, const Descriptor& b);

/// What a landmark looks like: up to four descriptors, of the views of it that were seen most often.
class DescriptorSet {
 public:
  static constexpr std::size_t kMost = 4;

  /// One more observation. It counts for the view that it is like; one that is like none takes an empty
  /// place, or that of the view that was seen least.
  void add(const Descriptor& descriptor);
  /// Those of the same landmark from another time.
  void add(const DescriptorSet& other);

  std::size_t size() const { return size_; }
  bool isEmpty() const { return size_ == 0; }
  const Descriptor& operator[](std::size_t i) const { return views_[i].descriptor; }

 private:
  struct View {
    Descriptor descriptor{};
    std::uint32_t seen = 0; ///< times
  };
  void add(const View& view);

  std::array<View, kMost> views_;
  std::size_t size_ = 0;
};

/// Of the two most alike; 256 where either is empty.
int distance(const DescriptorSet& a, const DescriptorSet& b);

} // namespace vi_ekf_slam
