#pragma once

#include <optional>
#include <vector>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/map/landmark_map.hpp"
#include "vi_ekf_slam/core/motion/motion_model.hpp"
#include "vi_ekf_slam/core/observation/stereo_model.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// A feature of the frame that is an active landmark's.
struct Association {
  std::size_t landmark = 0; ///< index in the map's active ones
  std::size_t feature = 0;  ///< index in the frame
};

/// The features of one frame, by what they are to the filter.
struct Associations {
  std::vector<Association> known;              ///< of landmarks that are before the camera
  std::vector<LinearMeasurement> measurements; ///< by them, one each
  std::vector<std::size_t> unknown;            ///< other usable features
};
/// `usable`: indices in the frame.
Associations associate(const Filter& filter, const LandmarkMap& map, const StereoModel& model,
                       const StereoFrame& frame, const std::vector<std::size_t>& usable);

/// What became of a frame's associations.
struct FrameOutcome {
  std::vector<bool> used; ///< association by association: it corrected the state
  /// It did not, but is no further off than the noise of one in 10,000: one measurement is left out, and
  /// nothing is said about the track.
  std::vector<bool> missed;
  bool skipped = false; ///< the frame contradicts the state as a whole and was not used
  /// Normalised innovations squared of the plausible ones, each judged by itself, summed. The ones that were
  /// used would not do: picking those that agree makes them look better than they are.
  double nis = 0.0;
  std::size_t nis_dof = 0;
  double capped_nis = 0.0; ///< of all, what is implausible counted as just plausible; 0 if skipped
};

/// Corrects the filter with one frame: consensus, plausibility of the whole, a second look at the rest, and
/// one update by all of them.
class FrameUpdate {
 public:
  struct Options {
    bool consensus = true; ///< 1-point RANSAC (for comparison: false)
    /// RMS residual of the four coordinates up to which a feature agrees, in sigmas of its pixels.
    double consensus_sigmas = 1.2;
    double gate = kChiSquare3; ///< for a single feature's three rows
    double frame_gate = 5.0;   ///< NIS per degree of freedom beyond which a whole frame is impossible
    /// Chi-square limit with 3 degrees of freedom for a feature to take part in the consensus at all: wide,
    /// since the consensus chooses.
    double plausible_gate = 30.0;
    /// Limit of the twist's correction by a frame, squared and in units of its prior covariance (6 degrees of
    /// freedom), beyond which the frame is impossible; a good one exceeds it once in 10^10.
    double motion_gate = 60.0;
  };

  FrameUpdate(const Options& options, const StereoModel& model, const MotionModel& motion)
      : options_(options), model_(model), motion_(motion) {}
  const StereoModel& model() const { return model_; }

  /// `filter` is settled.
  FrameOutcome apply(Filter& filter, std::vector<LinearMeasurement> measurements) const;

 private:
  std::vector<bool> choose(const Innovation& in, const std::vector<double>& nis) const;
  bool isPossible(Innovation& in, const Filter& filter) const;
  bool reconsider(Innovation& in, FrameOutcome& outcome) const;

  const Options& options_;
  const StereoModel& model_;
  const MotionModel& motion_;
};

} // namespace vi_ekf_slam
