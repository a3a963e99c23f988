#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "vi_ekf_slam/core/invariant/composition.hpp"
#include "vi_ekf_slam/core/invariant/deferred_step.hpp"
#include "vi_ekf_slam/core/invariant/landmark.hpp"

namespace vi_ekf_slam::invariant {

/// The landmarks out of view, in the joint covariance with the active state and with each other, exactly and
/// at a cost per frame that does not depend on how many they are. Their errors d along the world axes do not
/// change while the vehicle moves, and what the active state's updates do to them is linear in their
/// covariance with it, so it can wait: the steps are kept in a journal, which copies share, composed into
/// stretches, little by little, as landmarks leave, and settled when a landmark is wanted back.
class InactiveMap {
 public:
  using Columns3 = Pooled<Eigen::Matrix<double, Eigen::Dynamic, 3>>;

  /// Steps are composed once enough landmarks have left, or half of this memory is full; all at once where
  /// it is full.
  explicit InactiveMap(std::size_t most_journal_bytes) : most_journal_bytes_(most_journal_bytes) {}

  std::size_t size() const { return ids_.size(); }
  bool contains(FeatureId id) const { return ids_.count(id) != 0; }
  /// How many landmarks have left the active state since this one did. Throws std::out_of_range where `id` is
  /// not held.
  std::uint64_t departuresSince(FeatureId id) const { return last_serial_ - ids_.at(id); }

  /// The active state moved by `step`, to `size` rows.
  void record(DeferredStep step, Eigen::Index size);

  /// Landmark `landmark`, whose rows begin at `row`, leaves the active state and the last landmark takes its
  /// place, so that `size` rows are left: `covariance` of its error d, and `cross` (size x 3) of the active
  /// errors with d. Its id must not be held already.
  void add(const Landmark& landmark, const Eigen::Matrix3d& covariance, Columns3 cross, Eigen::Index row,
           Eigen::Index size);

  /// Landmarks from elsewhere (unique ids, the first one longest out of view) in the place of all that are
  /// held, out of view for longer than any that leaves from now on: `covariance` of their errors d (3k x 3k,
  /// m^2, world axes) and `cross` (n x 3k) of the active errors with them.
  void adopt(std::vector<Landmark> landmarks, Eigen::MatrixXd covariance, Eigen::MatrixXd cross);

  /// Composes the oldest steps, of about this cost, so that settle has less to do. Returns the cost.
  double compose(double operations);

  /// Does all that was deferred, for an active state of `size` rows, and makes room for `arrivals` landmarks
  /// to return. The cost is that of size() updates of the joint covariance.
  void settle(Eigen::Index size, std::size_t arrivals);

  /// A landmark of the settled map, and the covariance of its d with the errors d of the landmarks that stay
  /// (3 x 3k).
  struct Taken {
    InactiveLandmark inactive;
    Columns3 cross; ///< of the active errors with d
    Eigen::Matrix<double, 3, Eigen::Dynamic> others;
  };
  /// Takes a landmark out. To be called between settle and the next step. Throws std::out_of_range for an id
  /// that is not held.
  Taken take(FeatureId id);
  /// Three more rows of the active state, whose covariance with the d of the settled landmarks is `rows` (3 x
  /// 3k).
  void appendActive(const Eigen::Matrix<double, 3, Eigen::Dynamic>& rows);
  /// Covariance of the active errors with the d of the settled landmarks (n x 3k).
  auto settledCross() const { return settled_->cross.topLeftCorner(settled_->rows, 3 * settledCount()); }
  /// The settled landmarks and the covariance of their d (3k x 3k).
  const std::vector<Landmark>& settledLandmarks() const { return settled_->landmarks; }
  auto settledCovariance() const {
    return settled_->covariance.topLeftCorner(3 * settledCount(), 3 * settledCount());
  }
  /// Their places in settledLandmarks(), the one that is longest out of view first.
  std::vector<std::size_t> settledByAge() const;

  /// Marginalises the `count` landmarks that are longest out of view: the rest stays exact. Returns them as
  /// `estimates` would.
  std::vector<InactiveLandmark> marginaliseOldest(std::size_t count, Eigen::Index size);

  enum class Covariances { kLastSettled, kExact };
  /// All landmarks, at the means of now. Their covariances either exactly, at the cost of going through the
  /// journal, or as they were when last settled, which is never less.
  std::vector<InactiveLandmark> estimates(Eigen::Index size, Covariances covariances) const;

  /// What settle would cost now, in floating-point operations.
  double settlingCost(Eigen::Index size) const;
  /// Memory held, bytes.
  std::size_t bytes() const;

 private:
  struct Composed {
    std::shared_ptr<const Stretch> stretch;
    std::size_t gone = 0; ///< of its landmarks, marginalised since
    std::size_t left() const { return stretch->landmarks.size() - gone; }
  };
  struct Settled {
    std::vector<Landmark> landmarks;
    std::vector<std::uint64_t> serials; ///< the smaller, the longer out of view
    Eigen::Index rows = 0;              ///< of `cross` in use: the active errors when last settled
    Eigen::MatrixXd covariance;         ///< of the errors d; the top left part is in use
    Eigen::MatrixXd cross;              ///< of the active errors with d; the top left part is in use
  };

  Eigen::Index settledCount() const { return static_cast<Eigen::Index>(settled_->landmarks.size()); }
  Settled& ownSettled();
  const Departure* departureOf(const Removal& removal) const;
  void closeChunk();
  void forgetSteps();
  void forgetChunk();
  PooledDeque<std::shared_ptr<const Chunk>>::const_iterator endOfStretch() const;
  double composeOnce(double operations);
  void beginComposition();
  void endComposition();
  void eraseSettled(std::size_t index);

  std::shared_ptr<Settled> settled_ =
      std::make_shared<Settled>();                           // copied before a change while it is shared
  PooledDeque<Composed> stretches_;                          // first
  PooledDeque<std::shared_ptr<const Chunk>> journal_;        // after them
  PooledDeque<std::shared_ptr<const Departure>> departures_; // in the journal; serials are consecutive
  Chunk open_;
  Composition composition_;                     // of the first chunks of the journal, where one is under way
  MatrixStore store_;                           // of the journal's larger matrices
  MatrixStore composed_ = store_.another();     // of the stretches
  PooledHashMap<FeatureId, std::uint64_t> ids_; // to the number of the departure
  std::uint64_t last_serial_ = 0;
  std::size_t most_journal_bytes_;
  std::size_t journal_bytes_ = 0;
  double journal_cost_ = 0.0;  // of composing it, operations
  double composing_due_ = 0.0; // operations
};

} // namespace vi_ekf_slam::invariant
