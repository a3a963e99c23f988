#pragma once

#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "vi_ekf_slam/core/map/returning_landmarks.hpp"
#include "vi_ekf_slam/core/map/saved_map.hpp"

namespace vi_ekf_slam {

/// Looks for the place of a drive in a saved map, by ids that return: the drive so far is in a frame of its
/// own; when landmarks in view have ids of the map and their constellation is the map's, all is moved there.
/// Where they do not agree it goes on as if nothing had been tried.
class Relocaliser {
 public:
  explicit Relocaliser(std::shared_ptr<const SavedMap> map);

  /// Whether the place was found: everything is in the map's frame then.
  bool update(Filter& filter, LandmarkMap& landmarks, ReturningLandmarks& returning, const StereoModel& model,
              Stamp now);

  /// The vehicle is at `pose` in the map, known to `covariance` (6x6 of dp and theta): all is moved there.
  /// False, and nothing changes, where the filter would not be valid.
  bool placeAt(const SE3& pose, const Matrix6d& covariance, Filter& filter, LandmarkMap& landmarks) const;

 private:
  struct Place {
    SE3 map_T_session;
    std::vector<FeatureId> ids; ///< that lie there as they lie here
  };
  std::optional<Place> find(const Filter& filter, const LandmarkMap& landmarks) const;
  void enter(const SE3& map_T_session, Filter& filter, LandmarkMap& landmarks) const;
  bool moveTo(const Place& place, Filter& filter, LandmarkMap& landmarks, ReturningLandmarks& returning,
              const StereoModel& model, Stamp now) const;

  std::shared_ptr<const SavedMap> map_;
  std::unordered_map<FeatureId, std::size_t> index_; ///< of its landmarks, by id
  std::optional<Stamp> next_attempt_;
};

/// A saved map's covariance, a little larger than what rounding may have made of it.
Eigen::MatrixXd loadedCovariance(const SavedMap& map);

} // namespace vi_ekf_slam
