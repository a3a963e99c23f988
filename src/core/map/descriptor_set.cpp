#include "vi_ekf_slam/core/map/descriptor_set.hpp"

#include <algorithm>
#include <bitset>
#include <cstring>

namespace vi_ekf_slam {
namespace {

// Bits up to which two descriptors are of one view: consecutive frames' differ by less, a turn by some 20
// degrees changes more.
constexpr int kSameView = 32;

} // namespace

int hammingDistance(const Descriptor& a, const Descriptor& b) {
  std::size_t bits = 0;
  for (std::size_t i = 0; i < a.size(); i += 8) {
    std::uint64_t x = 0, y = 0;
    std::memcpy(&x, &a[i], 8);
    std::memcpy(&y, &b[i], 8);
    bits += std::bitset<64>(x ^ y).count();
  }
  return static_cast<int>(bits);
}

void DescriptorSet::add(const Descriptor& descriptor) { add(View{descriptor, 1}); }

void DescriptorSet::add(const DescriptorSet& other) {
  for (std::size_t i = 0; i < other.size_; ++i) add(other.views_[i]);
}

void DescriptorSet::add(const View& view) {
  View* nearest = nullptr;
  int least = kSameView + 1;
  for (std::size_t i = 0; i < size_; ++i) {
    const int bits = hammingDistance(views_[i].descriptor, view.descriptor);
    if (bits >= least) continue;
    least = bits;
    nearest = &views_[i];
  }
  if (nearest) {
    nearest->seen += view.seen;
  } else if (size_ < kMost) {
    views_[size_++] = view;
  } else {
    *std::min_element(views_.begin(), views_.end(),
                      [](const View& a, const View& b) { return a.seen < b.seen; }) = view;
  }
}

int distance(const DescriptorSet& a, const DescriptorSet& b) {
  int least = 256;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t j = 0; j < b.size(); ++j) least = std::min(least, hammingDistance(a[i], b[j]));
  }
  return least;
}

} // namespace vi_ekf_slam
