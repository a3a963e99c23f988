#pragma once

#include <sstream>
#include <string>

namespace vi_ekf_slam {

/// Three digits of it, for a sentence.
inline std::string rounded(double value) {
  std::ostringstream stream;
  stream.precision(3);
  stream << value;
  return stream.str();
}

} // namespace vi_ekf_slam
