#pragma once

#include <array>
#include <cstddef>
#include <deque>

#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// Why an estimate is no longer believed.
enum class Divergence : std::size_t {
  kNone = 0,
  kInnovations = 1, ///< larger than their covariance allows, for a while
  kRejections = 2,  ///< most frames contradicted the state, for a while
  kJump = 3,        ///< the static world was suddenly somewhere else: the vehicle was displaced
  kCovariance = 4,  ///< mean or covariance not finite, or the covariance not positive semidefinite
};
constexpr std::size_t kDivergenceCount = 5;

/// One word each, for files and diagnostics.
constexpr std::array<const char*, kDivergenceCount> kDivergenceNames = {"none", "innovations", "rejections",
                                                                        "jump", "covariance"};

/// Judges the estimator by what its frames said within the last seconds. One frame alone proves nothing: a
/// lorry that fills the view, or a front end that mixes up its tracks, spoils single ones. A frame speaks for
/// the time since the one before, but for no more than a third of the window: so the rate of the frames does
/// not matter, and silence is nobody's word.
class DivergenceMonitor {
 public:
  struct Options {
    double window_s = 2.0; ///< s; 0: never judges
    /// Mean NIS per degree of freedom beyond which it has diverged: innovations of twice their sigma.
    double nis = 4.0;
    /// Of the window's time; where frames are refused for so much or more of it that is a divergence: a lorry
    /// that fills the view spoils many.
    double refused_share = 0.8;
  };

  /// What a frame said about the estimate.
  struct Frame {
    Stamp stamp = 0;
    double distance = 0.0;   ///< m driven since the last frame
    double angle = 0.0;      ///< rad turned since the last frame
    std::size_t matched = 0; ///< features of known landmarks
    std::size_t used = 0;    ///< of them
    bool rejected = false;   ///< as a whole
    double nis = 0.0;        ///< normalised innovation squared
    std::size_t nis_dof = 0; ///< its degrees of freedom
  };

  explicit DivergenceMonitor(const Options& options) : options_(options) {}

  Divergence add(const Frame& frame);
  /// m driven and rad turned within the window, there and back added up.
  double distance() const { return sumOf(&Frame::distance); }
  double angle() const { return sumOf(&Frame::angle); }
  /// A new estimate: what was seen before does not count against it.
  void restart() { frames_.clear(); }

 private:
  struct Heard {
    Frame frame;
    double seconds; ///< for which it speaks
  };
  double sumOf(double Frame::*number) const;

  Options options_;
  std::deque<Heard> frames_;
};

} // namespace vi_ekf_slam
