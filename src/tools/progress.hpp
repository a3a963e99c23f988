#pragma once

#include <unistd.h>

#include <cstdio>
#include <string>

namespace vi_ekf_slam {

/// A bar on a terminal; nothing elsewhere, so that logs stay readable.
class Progress {
 public:
  explicit Progress(bool wanted) : visible_(wanted && isatty(STDERR_FILENO) != 0) {}
  /// `share` from 0 to 1.
  void show(double share) {
    const int percent = static_cast<int>(100.0 * share);
    if (!visible_ || percent == percent_) return;
    percent_ = percent;
    const std::string bar(static_cast<std::size_t>(percent / 2), '#');
    std::fprintf(stderr, "\r[%-50s] %3d%%", bar.c_str(), percent);
  }
  void finish() const {
    if (visible_ && percent_ >= 0) std::fputc('\n', stderr);
  }

 private:
  bool visible_;
  int percent_ = -1;
};

} // namespace vi_ekf_slam
