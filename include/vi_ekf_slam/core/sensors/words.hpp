#pragma once

#include <sstream>
#include <string>

namespace vi_ekf_slam {

/// Three digits of it, for a sentence, or so many.
inline std::string rounded(double value, int digits = 3) {
  std::ostringstream stream;
  stream.precision(digits);
  stream << value;
  return stream.str();
}

/// Adds what else is wrong, if anything, to `problems`.
inline void addProblem(std::string& problems, const std::string& problem) {
  problems += (problems.empty() || problem.empty() ? "" : "; ") + problem;
}

} // namespace vi_ekf_slam
