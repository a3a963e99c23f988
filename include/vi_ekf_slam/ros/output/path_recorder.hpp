#pragma once

#include <nav_msgs/Path.h>

#include <string>
#include <vector>

#include "vi_ekf_slam/core/map/path_estimate.hpp"

namespace vi_ekf_slam {

/// A path that stays small: points at least a distance apart, and every second one dropped (the distance
/// doubled) when there are too many, so that the whole path stays visible.
class PathRecorder {
 public:
  /// `frame`: the path's header.frame_id; `min_distance_m` in m: a step of what is carried by hand. More
  /// points than `max_points` a screen does not show.
  explicit PathRecorder(std::string frame, std::size_t max_points = 10000, double min_distance_m = 0.05);

  /// Whether the pose became a point.
  bool add(Stamp stamp, const SE3& pose);
  /// All points are where the path has them, whatever they were corrected by before.
  void correct(const PathEstimate& path);
  void clear();
  const nav_msgs::Path& message() const { return path_; }

 private:
  void thin();

  std::size_t max_points_;
  double configured_distance_;
  double min_distance_;
  nav_msgs::Path path_;
  struct Added {
    Stamp stamp;
    SE3 pose;
  };
  std::vector<Added> added_; ///< the points as they were added
};

} // namespace vi_ekf_slam
