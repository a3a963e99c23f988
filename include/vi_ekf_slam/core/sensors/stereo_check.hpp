#pragma once

#include <string>

#include "vi_ekf_slam/core/sensors/pair_check.hpp"
#include "vi_ekf_slam/core/sensors/track_id_check.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {

/// What the first features tell of pairs and of ids. Nothing is dropped for it.
class StereoCheck {
 public:
  /// Features as they come, before any is dropped. `pixel_sigma`, px: of those that do not state theirs.
  /// Returns what is wrong, with figure, limit and what to do, once each; else empty.
  std::string note(const StereoFrame& frame, double pixel_sigma) {
    std::string said = pair_.note(frame, pixel_sigma);
    addProblem(said, ids_.note(frame));
    addProblem(problem_, said);
    return said;
  }
  /// What is wrong; empty: nothing, or not known yet.
  const std::string& problem() const { return problem_; }

 private:
  PairCheck pair_;
  TrackIdCheck ids_;
  std::string problem_;
};

} // namespace vi_ekf_slam
