#pragma once

#include <cstddef>
#include <unordered_map>
#include <vector>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/map/archive.hpp"
#include "vi_ekf_slam/core/map/descriptor_set.hpp"
#include "vi_ekf_slam/core/map/saved_map.hpp"

namespace vi_ekf_slam {

/// What is known of a landmark beside its position, which the filter has.
struct Landmark {
  FeatureId id = 0;
  Handle variable = 0;
  std::size_t observations = 1; ///< that corrected the state, the first one included
  Stamp first_seen = 0;
  Stamp last_seen = 0;            ///< in a frame that was used
  bool reactivated = false;       ///< from an earlier time, not in a frame that was used since
  bool in_map = false;            ///< has been kept before
  bool suspect = false;           ///< its track has contradicted the static world: not for the map
  bool missed = false;            ///< its last measurement was left out
  DescriptorSet descriptors = {}; ///< what it looks like, where the front end says so
};

enum class MapKeep {
  kNone, ///< landmarks out of view are marginalised; their last estimates stay in the map
  kGood, ///< those that were tracked for long enough stay in the joint covariance
  kAll,  ///< all of them do
};

/// The life of landmarks: active while tracked, then inactive in the joint covariance, or a last estimate.
class LandmarkMap {
 public:
  struct Options {
    MapKeep keep = MapKeep::kGood;
    double min_track_s = 0.9; ///< s that a good landmark was tracked for
    /// Of so many good landmarks one is kept, by its id: the cost of a closure grows with their square, and a
    /// few dozen tell a view again.
    std::size_t one_in = 1;
    /// Inactive in the joint covariance; beyond it those that were tracked the longest time ago are
    /// marginalised, and their last estimates stay in the map.
    std::size_t max_landmarks = 2000;
  };

  explicit LandmarkMap(const Options& options);

  bool keepsInactive() const { return options_.keep != MapKeep::kNone; }
  const std::vector<Landmark>& active() const { return active_; }
  Landmark& active(std::size_t index) { return active_[index]; }
  /// Where each is in active(), by id; the first one of those that share an id.
  std::unordered_map<FeatureId, std::size_t> indexById() const;
  /// How many of those in view will be kept: after so many others the view is another one.
  std::size_t keptOfView() const { return active_.size() / options_.one_in; }
  /// Of an inactive landmark.
  bool isInactive(FeatureId id) const { return inactive_by_id_.count(id) != 0; }
  Handle inactiveVariable(FeatureId id) const { return inactive_by_id_.at(id); }
  const Landmark& inactive(Handle variable) const { return inactive_.at(variable); }
  bool isLandmark(Handle variable) const { return inactive_.count(variable) != 0; }
  std::size_t inactiveCount() const { return inactive_.size(); }
  const Archive& archive() const { return archive_; }
  Archive& archive() { return archive_; }

  /// A new active landmark, the last one.
  void add(const Landmark& landmark) { active_.push_back(landmark); }
  /// An active landmark is tracked no more: it goes where the options want it, or is forgotten if suspect.
  /// The last one takes its place.
  void leave(Filter& filter, std::size_t index);
  /// One that contradicted the static world, or another one's duplicate, is forgotten.
  void discard(Filter& filter, std::size_t index);
  /// Makes inactive, whatever the options say; there is none of its id.
  void deactivate(Filter& filter, std::size_t index);
  /// Inactive landmarks are the last active ones, in this order.
  void reactivate(Filter& filter, const std::vector<FeatureId>& ids);
  /// Inactive ones that should come into view within some seconds, in the place of those before.
  void expect(std::vector<FeatureId> ids, Stamp now);
  /// Those of them that are inactive still, and whose id no active one has.
  std::vector<FeatureId> expected(Stamp now) const;
  Stamp expectedSince() const { return expected_since_; }
  /// Marginalises what has been inactive for the longest time, where there is too much; `all`: all. The last
  /// estimates of what was not a landmark.
  std::vector<InactiveStore::Estimate> bound(Filter& filter, bool all = false);
  /// The landmarks of another map, inactive, with Filter::adopt's covariances. With `renumbered`, where ids
  /// say nothing about them, number i has the id kRenumbered + i.
  void adopt(Filter& filter, const SavedMap& map, Eigen::MatrixXd covariance, Eigen::MatrixXd cross,
             bool renumbered = false);
  static constexpr FeatureId kRenumbered = FeatureId{1} << 63; ///< above what front ends count to
  /// No landmark is active or inactive any more; the filter is another one.
  void clear();
  /// The same, for a filter that is to be given up: all estimates that are valid go to the archive.
  void archiveAll(const Filter& filter);

  /// Calls visit(Landmark, Estimate) for each one out of view. The estimate's covariance may be of when it
  /// was last settled, which is never less.
  template <class Visit>
  void forEachOutOfView(const Filter& filter, const Visit& visit) const {
    for (const InactiveStore::Estimate& estimate : filter.inactive().estimates(false)) {
      const auto found = inactive_.find(estimate.variable.handle);
      if (found != inactive_.end()) visit(found->second, estimate);
    }
  }

  /// Every landmark by id, once; `inactive` are the filter's estimates.
  std::vector<LandmarkEstimate> estimates(const Filter& filter,
                                          const std::vector<InactiveStore::Estimate>& inactive) const;
  std::vector<LandmarkEstimate> estimates(const Filter& filter, bool exact) const {
    return estimates(filter, filter.inactive().estimates(exact));
  }

 private:
  LandmarkEstimate estimateOf(const Filter& filter, const Landmark& landmark) const;
  void drop(std::size_t index);
  void putInactive(Landmark landmark);
  Landmark takeInactive(Handle variable);
  bool isGood(const Landmark& landmark) const;

  Options options_;
  std::vector<Landmark> active_;
  std::unordered_map<Handle, Landmark> inactive_;
  std::unordered_map<FeatureId, Handle> inactive_by_id_;
  std::vector<FeatureId> expected_;
  Stamp expected_since_ = 0;
  Archive archive_;
};

} // namespace vi_ekf_slam
