#pragma once

#include <optional>

#include "vi_ekf_slam/core/invariant/config.hpp"
#include "vi_ekf_slam/core/invariant/stereo_update.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam::invariant {

/// What a frame's observations did.
struct FrameOutcome {
  PooledVector<bool> used; ///< observation by observation: it corrected the state
  bool rejected = false;   ///< the frame contradicts the state as a whole; nothing was changed
  /// Normalised innovations squared of the plausible observations, each judged by itself, summed. The ones
  /// that were used would not do: picking those that agree makes them look better than they are.
  double nis = 0.0;
  std::size_t nis_dof = 0;
};

/// What is needed to believe that the body turned harder than the model of motion allows: a bump, a kerb.
struct Manoeuvre {
  double dt = 0.0;                ///< s since the last frame
  std::optional<GyroSample> gyro; ///< the last sample, with covariance, if it belongs to this interval
};

/// Corrects the state with the observations of one frame: consensus, plausibility of the whole, rescue.
class FrameUpdate {
 public:
  FrameUpdate(const InvariantConfig& config, const StereoModel& model) : config_(config), model_(model) {}

  /// `observations` are those of `frame` against `state`.
  FrameOutcome apply(State& state, const StereoFrame& frame, PooledVector<Observation> observations,
                     const Manoeuvre& manoeuvre) const;

 private:
  struct Plan {
    FrameOutcome outcome;
    Correction correction;
  };

  std::optional<Plan> makePlan(const State& state, const PooledVector<Observation>& observations) const;
  PooledVector<bool> choose(const PooledVector<Observation>& observations, const PooledMatrix& S,
                            const PooledVector<double>& nis) const;
  bool mayBeManoeuvre(const PooledVector<Observation>& observations, const Manoeuvre& manoeuvre) const;
  bool allowManoeuvre(State& state, const StereoFrame& frame, PooledVector<Observation>& observations,
                      const Manoeuvre& manoeuvre) const;
  std::optional<Observation> observeAgain(const State& state, const StereoFrame& frame,
                                          const Observation& observation) const;
  void rescue(State& state, const StereoFrame& frame, const PooledVector<Observation>& observations,
              FrameOutcome& outcome) const;

  const InvariantConfig& config_;
  const StereoModel& model_;
};

} // namespace vi_ekf_slam::invariant
