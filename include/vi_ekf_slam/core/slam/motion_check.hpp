#pragma once

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/sensors/clock_offset.hpp"
#include "vi_ekf_slam/core/slam/invariant_estimator.hpp"

namespace vi_ekf_slam {

/// Looks whether gyro and velocity move the body as the pictures do: a transform to the camera that is
/// inverted, a sensor in another unit, backwards, along other axes or of another clock makes an estimate that
/// is wrong all along. Beside the filter, stereo odometry of the pictures alone is compared with each sensor
/// over windows of a second, until enough of them agree or contradict. Nothing is dropped for it.
class MotionCheck {
 public:
  /// Of a filter that is configured so.
  explicit MotionCheck(const InvariantConfig& config);

  void setRig(const StereoRig& rig) { config_.told_rig = rig; }
  // In the order of stamps.
  void note(const ImuSample& sample);
  /// Of the IMU's own velocity.
  void note(const VelocitySample& sample);
  /// Returns what is wrong, with figure, limit and what to do, the one time that it is found; else empty.
  std::string note(const StereoFrame& frame);
  /// Says once that velocities contradict the estimate for some time, as those of wheels that slip do.
  std::string note(const FrameReport& report);
  /// What is wrong; empty: nothing, or not known yet.
  const std::string& problem() const { return problem_; }
  /// Time, or the estimate, begins anew: what is judged already stays.
  void restart();

 private:
  /// Samples of a sensor from one frame to the next.
  struct Samples {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double variances = 0.0; ///< of those in the sum, all three axes
    std::size_t count = 0, taken = 0;
    std::optional<Stamp> last;
    Eigen::Vector3d newest = Eigen::Vector3d::Zero();
    bool is_stuck = true; ///< all have been the same number
    // Of the last ones that were taken:
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    double variance = 0.0;

    void add(Stamp stamp, const Eigen::Vector3d& value, double sample_variance);
    /// Whether there is one of now.
    bool isFresh(Stamp now) const;
    /// False where there is none of now.
    bool take(Stamp now);
  };
  /// A second under way.
  struct Window {
    Stamp begin = 0, last = 0;
    std::unique_ptr<InvariantEstimator> odometry; ///< of the pictures alone
    SE3 start;                                    ///< its pose at the begin
    // What is told, in the body's axes at the begin, and of what variance:
    Eigen::Matrix3d turned = Eigen::Matrix3d::Identity();
    Eigen::Vector3d way = Eigen::Vector3d::Zero();  ///< m
    double angle = 0.0;                             ///< rad, of all turns, which may be several
    Eigen::Vector3d rate = Eigen::Vector3d::Zero(); ///< rad/s, at the begin
    std::size_t gyro_samples = 0;
    double turned_variance = 0.0, way_variance = 0.0;
    bool has_gyro = true, has_velocity = true; ///< all along
  };
  /// The motion of a window, in rad or m: told by the sensor, as a whole and from its begin to its end, seen
  /// by the pictures, how far these two are apart, and by which share of the motion they may be.
  struct Compared {
    double whole, told, seen;
    Eigen::Vector3d apart; ///< the body's axes
    double share;
    double allowed() const { return share * std::max(told, seen); }
    bool agrees() const { return apart.norm() < allowed(); }
  };
  struct Judged {
    std::vector<Compared> windows, contradicting;
    bool is_done = false;
    /// `sigma` of how far they are apart; `offset`: how far they may be in all windows alike.
    void add(const Compared& motion, double sigma, double offset);
    bool contradicts() const;
    /// Of those that contradict, by how far they are apart.
    Compared median() const;
  };

  bool hasWork(Stamp now) const;
  void begin(const StereoFrame& frame);
  std::string judge();
  std::string judgeClock(const Eigen::Matrix3d& seen, double sigma);
  std::string turnProblem() const;
  std::string wayProblem() const;
  static std::string asThePicturesDo(const Judged& judged, const std::string& unit, const std::string& hint);

  InvariantConfig config_;
  Samples gyro_, velocity_;
  Judged turn_, way_;
  ClockOffset clock_;
  bool knows_clock_;             ///< or cannot
  std::optional<Window> window_; ///< while there is work
  double bias_sigma_ = 0.0;      ///< rad/s, of the gyro, all three axes
  double worked_s_ = 0.0;
  std::optional<Stamp> contradicts_since_; ///< in each frame since
  bool says_slip_ = false;
  std::string problem_;
};

} // namespace vi_ekf_slam
