#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>

#include "vi_ekf_slam/core/invariant/deferred_step.hpp"
#include "vi_ekf_slam/core/invariant/landmark.hpp"

namespace vi_ekf_slam::invariant {

/// A landmark that left the active state: as it was then, and the covariance of the active errors with its d
/// (n x 3).
struct Departure {
  InactiveLandmark inactive;
  Pooled<Eigen::Matrix<double, Eigen::Dynamic, 3>> cross;
  std::uint64_t serial;
};

/// Deferred steps, one after another.
struct Chunk {
  Eigen::Index size = 0; ///< of the active errors at its beginning
  PooledVector<DeferredStep> steps;
  std::uint64_t last_serial = 0; ///< of the departures until its end
};

/// What the steps of some chunks come to, for the landmarks that left before them and for those that left
/// by the way, the first one first.
struct Stretch {
  KeptMatrix F;           ///< the active errors x at its end are F times those at its beginning, and noise
  KeptMatrix information; ///< var(d) -= c^T information c, for c = cov(x at its beginning, d)
  Pooled<Eigen::VectorXd> learned;  ///< mean(d) += c^T learned
  PooledVector<Landmark> landmarks; ///< that left, as they are at its end
  PooledVector<std::uint64_t> serials;
  KeptMatrix covariance; ///< of their d at its end
  KeptMatrix cross;      ///< of x at its end with their d
  KeptMatrix origin;     ///< covariance of their d with earlier ones, in terms of x at its beginning
};

/// About what it takes to compose the step, in floating-point operations.
double costOf(const DeferredStep& step);

/// How many rows the active state gains by the step.
Eigen::Index gainOf(const DeferredStep& step);

/// Makes one stretch of some chunks, a few steps at a time. A copy is an empty one: it would cost memory, and
/// what is copied begins anew if it must.
class Composition {
 public:
  using Chunks = PooledVector<std::shared_ptr<const Chunk>>;
  using Departures = PooledVector<std::shared_ptr<const Departure>>;

  Composition() = default;
  /// Of `chunks`, not empty, and the departures that belong to their removals.
  Composition(Chunks chunks, Departures departures);
  Composition(const Composition& /*other*/) : Composition() {}
  Composition& operator=(const Composition& other) { return *this = Composition(other); }
  Composition(Composition&&) = default;
  Composition& operator=(Composition&&) = default;
  ~Composition() = default;

  bool isEmpty() const { return chunks_.empty(); }
  const Chunks& chunks() const { return chunks_; }
  bool isDone() const { return chunk_ == chunks_.size(); }
  /// Of what has been composed.
  double cost() const { return cost_; }

  /// Goes on for steps that cost `operations` together, and the one that goes beyond; returns their cost.
  double advance(double operations);
  /// Once done; its matrices are in `store`.
  Stretch stretch(MatrixStore& store) const;

 private:
  void forward(const DeferredStep& step);

  Chunks chunks_;
  Departures departures_;
  std::size_t chunk_ = 0, step_ = 0, departed_ = 0; ///< the next ones
  double cost_ = 0.0;
  std::optional<ForwardSweep> sweep_;
  /// Column by column: covariance of the d of those that leave, when they do, with all errors that the sweep
  /// takes along.
  PooledMatrix leaving_;
};

} // namespace vi_ekf_slam::invariant
