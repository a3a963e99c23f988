#pragma once

#include <algorithm>
#include <cstddef>

namespace vi_ekf_slam {

/// The middle one of `values`, the upper of two; at least one.
template <typename Values>
auto medianOf(Values values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

} // namespace vi_ekf_slam
