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

/// Adds what else is wrong, if anything, to `problems`.
inline void addProblem(std::string& problems, const std::string& problem) {
  problems += (problems.empty() || problem.empty() ? "" : "; ") + problem;
}

} // namespace vi_ekf_slam
