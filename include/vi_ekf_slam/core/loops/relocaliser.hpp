#pragma once

#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "vi_ekf_slam/core/loops/appearance_index.hpp"
#include "vi_ekf_slam/core/loops/place_recogniser.hpp"
#include "vi_ekf_slam/core/loops/returning_landmarks.hpp"
#include "vi_ekf_slam/core/map/saved_map.hpp"

namespace vi_ekf_slam {

/// Looks for the place of a drive in a saved map, by ids that return or by what landmarks look like: the
/// drive so far is in a frame of its own; when landmarks in view are those of the map by their ids and their
/// constellation is the map's, or by their looks, several times and some way apart, all is moved there. Where
/// they do not agree it goes on as if nothing had been tried. Found by looks, the map's landmarks get new
/// ids.
class Relocaliser {
 public:
  /// Landmarks that must agree: in a map of fewer no place is found.
  static constexpr std::size_t kLeastMatches = 6;

  explicit Relocaliser(std::shared_ptr<const SavedMap> map);

  /// Whether the place was found: everything is in the map's frame then.
  bool update(Filter& filter, LandmarkMap& landmarks, ReturningLandmarks& returning, Stamp now);

  /// The vehicle is at `pose` in the map, known to `covariance` (6x6 of dp and theta): all is moved there.
  /// False, and nothing changes, where the filter would not be valid.
  bool placeAt(const SE3& pose, const Matrix6d& covariance, Filter& filter, LandmarkMap& landmarks) const;

 private:
  struct Place {
    SE3 map_T_session;
    /// That lie there as they lie here: landmarks in view by their ids, and which of the map.
    std::vector<std::pair<FeatureId, std::size_t>> matches;
    bool by_id = true;
  };
  using Candidates = LookUps::Candidates; ///< (active one, which of the map)
  std::optional<Place> find(const Filter& filter, const LandmarkMap& landmarks, const Candidates& candidates,
                            double share) const;
  Candidates candidatesById(const LandmarkMap& landmarks) const;
  std::optional<Place> findByLooks(const Filter& filter, const LandmarkMap& landmarks);
  void enter(const SE3& map_T_session, Filter& filter, LandmarkMap& landmarks, bool renumbered = false) const;
  bool moveTo(const Place& place, Filter& filter, LandmarkMap& landmarks,
              ReturningLandmarks& returning) const;

  std::shared_ptr<const SavedMap> map_;
  std::unordered_map<FeatureId, std::size_t> index_; ///< of its landmarks, by id
  AppearanceIndex known_;
  LookUps look_ups_;
  PlaceAgreement agreement_;
  std::optional<Stamp> next_attempt_;
};

} // namespace vi_ekf_slam
