#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <vector>

namespace vi_ekf_slam {

/// The middle one of `values`, the upper of two; at least one.
template <typename Values>
double medianOf(const Values& values) {
  std::vector<double> sorted(std::begin(values), std::end(values));
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  return *middle;
}

} // namespace vi_ekf_slam
