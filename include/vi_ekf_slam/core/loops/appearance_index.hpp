#pragma once

#include <Eigen/Core>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/map/landmark_map.hpp"

namespace vi_ekf_slam {

/// A landmark that may be found again by what it looks like.
struct KnownLook {
  FeatureId id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();   ///< world, m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(); ///< m^2, world axes
  DescriptorSet descriptors;
};

/// Whether two landmarks that look alike may be one point that is in the map more than once: `d` is between
/// them, m, of this covariance, m^2.
bool mayBeSame(const Eigen::Vector3d& d, const Eigen::Matrix3d& covariance);

/// The one that looks most alike, of those that are offered, and how much the next one elsewhere does.
struct MostAlike {
  std::size_t first = 0;
  int bits = 256, next_bits = 256;

  /// Another one, which may be the first one's point once more where `is_first()`.
  template <class IsFirst>
  void offer(std::size_t i, int bits_of_i, const IsFirst& is_first) {
    if (bits_of_i >= next_bits) return;
    const bool is_other = bits < 256 && !is_first();
    if (bits_of_i < bits) {
      if (is_other) next_bits = bits;
      first = i;
      bits = bits_of_i;
    } else if (is_other) {
      next_bits = bits_of_i;
    }
  }
  /// Whether it is alike, and no other nearly as much.
  bool isClear() const;
  /// Bits by which one point may differ from another time.
  static constexpr int kMostBits = 72;
};

/// The landmarks of a map by what they look like. A look-up compares with each that is in reach: 10,000 of
/// four descriptors take a tenth of a millisecond or two, so that hashing would gain nothing that a frame
/// feels, and it misses some of those that differ by as many bits as another day's light changes.
class AppearanceIndex {
 public:
  AppearanceIndex() = default;
  explicit AppearanceIndex(std::vector<KnownLook> known) : known_(std::move(known)) {}

  bool isEmpty() const { return known_.empty(); }
  std::size_t size() const { return known_.size(); }
  const KnownLook& operator[](std::size_t i) const { return known_[i]; }

  /// The one of those for which `allows(const KnownLook&)` that looks like `descriptors`. Nothing where none
  /// does, or where one that is elsewhere looks nearly as much like it.
  template <class Allows>
  std::optional<std::size_t> find(const DescriptorSet& descriptors, const Allows& allows) const {
    MostAlike best;
    for (std::size_t i = 0; i < known_.size(); ++i) {
      if (!allows(known_[i])) continue;
      best.offer(i, distance(descriptors, known_[i].descriptors), [&] { return isSame(best.first, i); });
    }
    return best.isClear() ? std::make_optional(best.first) : std::nullopt;
  }

 private:
  bool isSame(std::size_t a, std::size_t b) const {
    return a == b ||
           mayBeSame(known_[a].position - known_[b].position, known_[a].covariance + known_[b].covariance);
  }

  std::vector<KnownLook> known_;
};

/// Which of the known landmarks those in view look like: each is looked up when it comes into view, and again
/// when twice as much of it has been seen, a bounded number in a frame.
class LookUps {
 public:
  /// Landmarks in view (index of the active ones) and the known ones (id) that they look like.
  using Candidates = std::vector<std::pair<std::size_t, FeatureId>>;

  /// `most`: look-ups in a frame.
  explicit LookUps(std::size_t most) : most_(most) {}

  /// Of the active landmarks for which `mayReturn(const Landmark&)` those that are due; `reachOf(const
  /// Landmark&)` gives what AppearanceIndex::find allows.
  template <class MayReturn, class ReachOf>
  void update(const LandmarkMap& map, const AppearanceIndex& known, const MayReturn& mayReturn,
              const ReachOf& reachOf) {
    std::unordered_map<FeatureId, LookUp> in_view;
    std::size_t done = 0;
    for (const Landmark& landmark : map.active()) {
      if (!mayReturn(landmark)) continue;
      const auto last = last_.find(landmark.id);
      LookUp& look_up = in_view[landmark.id];
      if (last != last_.end()) look_up = last->second;
      if (look_up.observations * 2 > landmark.observations || done == most_) continue;
      ++done;
      look_up = {landmark.observations, std::nullopt};
      if (const auto found = known.find(landmark.descriptors, reachOf(landmark)))
        look_up.known = known[*found].id;
    }
    last_.swap(in_view);
  }

  /// Without those that two landmarks in view claim: two cannot be one.
  Candidates candidates(const LandmarkMap& map) const;
  /// As if the landmark in view had not been looked up yet.
  void forget(FeatureId id) { last_.erase(id); }
  void restart() { last_.clear(); }

 private:
  struct LookUp {
    std::size_t observations = 0; ///< of the landmark by then
    std::optional<FeatureId> known;
  };

  std::size_t most_;
  std::unordered_map<FeatureId, LookUp> last_; ///< of landmarks in view
};

} // namespace vi_ekf_slam
