#pragma once

#include <optional>

#include "vi_ekf_slam/core/map/landmark_map.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// What all tracks do together that the static world does not: a front end's tracks lag and slide with the
/// flow, so that the points they stand for move with the vehicle, by a fraction of its displacement and
/// turning about it. A variable of the core, s = (fraction s_p of the displacement, rad turned per m s_r in
/// the body's axes), zero in the mean and correlated over a length of the way (Ornstein-Uhlenbeck). Over a
/// displacement u (m, world) every point x that is tracked moves by
///
///   u s_p + |u| (R s_r) x (x - p),
///
/// which no measurement of the tracks can tell from a motion of the body. Tracks of a front end that states
/// their sigma are taken at its word: ours does not lag (docs/front_end.md).
class TrackSlip {
 public:
  /// Standard deviations.
  struct Options {
    double sigma = 0.02;            ///< of the displacement (1); 0: tracks do not slip
    double rotation_sigma = 0.0001; ///< rad/m
    double length_m = 20.0;         ///< over which it stays the same
  };

  static constexpr const char* kName = "slip"; ///< of its variable, in a saved map

  explicit TrackSlip(const Options& options) : options_(options) {}

  /// Adds its variable to a filter's core.
  void addTo(Filter& filter);
  /// The body has moved by `distance_m` since the last frame: in the core. Before the filter is settled.
  void propagate(Filter& filter, double distance_m) const;
  /// Whether the tracks of a frame may slip at all.
  static bool isPossible(const StereoFrame& frame);
  /// The landmarks that are in view have slipped over its displacement, world, m.
  void apply(Filter& filter, const LandmarkMap& map, const Eigen::Vector3d& displacement) const;

 private:
  Eigen::Vector4d variances() const;

  Options options_;
  std::optional<Handle> variable_;
};

} // namespace vi_ekf_slam
