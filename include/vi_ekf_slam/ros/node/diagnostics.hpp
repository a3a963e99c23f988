#pragma once

#include <diagnostic_updater/diagnostic_updater.h>

#include <algorithm>
#include <array>
#include <deque>
#include <optional>
#include <string>

#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/node/latency_meter.hpp"
#include "vi_ekf_slam/ros/node/results.hpp"
#include "vi_ekf_slam/ros/node/work_queue.hpp"
#include "vi_ekf_slam/ros/output/publishers.hpp"

namespace vi_ekf_slam {

/// Rate of a stream by its stamps, over the last few messages.
class RateMeter {
 public:
  void add(Stamp stamp);
  /// Hz of sensor time; 0 with fewer than two messages.
  double rate() const;
  /// s of wall time since the last message; nothing before the first.
  std::optional<double> silence() const;

 private:
  std::deque<Stamp> stamps_;
  std::optional<ros::WallTime> last_;
};

/// diagnostic_updater's in the name of a node's parameters, since in a nodelet manager the process has
/// another one, and by wall time, since the simulated clock of a bag may stand still.
class DiagnosticUpdater : public diagnostic_updater::Updater {
 public:
  DiagnosticUpdater(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
      : Updater(nh, private_nh, private_nh.getNamespace()) {
    setHardwareID("vi_ekf_slam");
  }
  /// Reports every ~diagnostic_period, 1 s where it is not set.
  void reportIfDue() {
    if (secondsSince(last_report_) < std::max(0.05, getPeriod())) return;
    last_report_ = WorkQueue::Clock::now();
    force_update();
  }

 private:
  WorkQueue::Clock::time_point last_report_ = WorkQueue::Clock::now();
};

/// What /diagnostics says about the node.
class Diagnostics {
 public:
  /// What is watched; must outlive this.
  struct Sources {
    const SlamSystem& system;
    const Intake& intake;
    const Publishers& publishers;
    const WorkQueue& queue;
    const Results& results;
  };

  Diagnostics(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const Sources& sources);

  /// `arrival`: in the callback.
  void noteInput(Stream stream, const ros::Time& stamp, WorkQueue::Clock::time_point arrival);
  /// Stamps begin anew, for this reason.
  void restart(const std::string& reason) {
    latency_.restart();
    reset_reason_ = reason;
  }
  /// Intake's, and what was shed before it.
  std::map<std::string, std::uint64_t> allTurnedAway() const;
  void noteOutput(const Output& output, bool is_frame);
  void reportIfDue() { updater_.reportIfDue(); }
  /// The node ends by this: nothing is reported after it.
  void fail(const std::string& failure) {
    updater_.broadcast(diagnostic_msgs::DiagnosticStatus::ERROR, failure);
  }

 private:
  using Status = diagnostic_updater::DiagnosticStatusWrapper;

  void inputs(Status& status);
  void calibration(Status& status);
  void frames(Status& status);
  void estimator(Status& status);
  void divergence(Status& status);
  void map(Status& status);
  void results(Status& status);
  void load(Status& status);
  void drops(Status& status);

  /// Counts that the last report had.
  struct Reported {
    std::uint64_t shed = 0, drops = 0, resets = 0;
    std::array<std::uint64_t, kDivergenceCount> divergences{};
  };

  Sources from_;
  LatencyMeter latency_;
  Reported reported_;
  std::string reset_reason_; ///< of the last one
  std::array<RateMeter, kStreamCount> rates_;
  Stamp newest_input_ = 0;
  Stamp newest_output_ = 0;
  std::optional<Output> last_frame_;
  double slowest_update_s_ = 0.0; ///< since the last report
  DiagnosticUpdater updater_;
};

} // namespace vi_ekf_slam
