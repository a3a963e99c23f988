#pragma once

#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "vi_ekf_slam/core/tracking/frame_update.hpp"
#include "vi_ekf_slam/core/tracking/standing_track.hpp"

namespace vi_ekf_slam {

/// What the tracks in view are (docs/architecture.md): rejected ones contradict the static world and are not
/// used until they have stood in one place for long enough; what once was rejected stays suspect and never
/// enters the map that is kept; of a skipped frame it is remembered where its tracks stood.
class TrackStatus {
 public:
  /// The features of a frame that may be used, by their indices, and how many of the others are what.
  struct Usable {
    std::vector<std::size_t> features;
    std::size_t invalid = 0, rejected = 0;
  };
  Usable usable(const Filter& filter, const StereoModel& model, const StereoFrame& frame);

  /// This one contradicts the static world from now on.
  void reject(const Filter& filter, const StereoModel& model, const StereoFrame& frame, std::size_t feature);
  bool isRejected(FeatureId id) const { return rejected_.count(id) != 0; }
  bool isSuspect(FeatureId id) const { return suspects_.count(id) != 0; }

  /// The frame corrected the local map, or began it.
  void noteUse(Stamp frame);
  /// Nothing is known of any track.
  void clear();

  /// Whether the local map is believed, more than a frame that contradicts it and comes after `last_frame`.
  /// It is not what is in view where the front end has begun other tracks than it has, where the frames agree
  /// among themselves on what else stands there, or where they have contradicted it for too long.
  bool believesMap(const Filter& filter, const StereoModel& model, const StereoFrame& frame,
                   const Associations& seen, std::optional<Stamp> last_frame);

 private:
  bool hasStood(const Filter& filter, const StereoModel& model, const StereoFrame& frame,
                std::size_t feature);
  bool isAnotherView(const Filter& filter, const StereoModel& model, const StereoFrame& frame,
                     const Associations& seen);

  /// In view, and where they have stood since they contradicted the static world.
  std::unordered_map<FeatureId, std::optional<StandingTrack>> rejected_;
  std::unordered_set<FeatureId> suspects_; ///< in view, that once did
  /// Of the frames that were skipped since the last used one.
  std::unordered_map<FeatureId, StandingTrack> skipped_;
  std::optional<Stamp> last_used_; ///< frame that corrected the local map, or began it
};

} // namespace vi_ekf_slam
