#pragma once

#include <geometry_msgs/PoseWithCovarianceStamped.h>
#include <ros/ros.h>

#include <map>
#include <memory>
#include <string>

#include "vi_ekf_slam/core/sensors/arrival_check.hpp"
#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/node/diagnostics.hpp"
#include "vi_ekf_slam/ros/node/map_store.hpp"
#include "vi_ekf_slam/ros/node/results.hpp"
#include "vi_ekf_slam/ros/node/services.hpp"
#include "vi_ekf_slam/ros/node/settings.hpp"
#include "vi_ekf_slam/ros/node/subscriptions.hpp"
#include "vi_ekf_slam/ros/node/worker.hpp"
#include "vi_ekf_slam/ros/output/output_sequencer.hpp"
#include "vi_ekf_slam/ros/output/publishers.hpp"

namespace vi_ekf_slam {

/// Connects topics and parameters to Intake, SlamSystem, Publishers and Results; the same for the node and
/// the nodelet.
///
/// Three threads: the callbacks of the topics (the node's or nodelet's queue) only put messages into a
/// WorkQueue; the worker takes them out, computes and publishes, and owns everything but that queue; services
/// have a thread of their own, hand their work to the worker and wait for it; what they save is a copy that
/// the worker makes, computed and written in their thread.
class SlamNode {
 public:
  /// Throws ConfigError, MapError for ~map_file, or std::runtime_error when output_dir cannot be made: the
  /// node must not start then.
  SlamNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh);
  /// Calls finish().
  ~SlamNode();
  SlamNode(const SlamNode&) = delete;
  SlamNode& operator=(const SlamNode&) = delete;

  /// The data are over: processes what is still held (for a few seconds at most) and saves everything. A
  /// second call does nothing.
  void finish();

  /// What ended the computing early, where everything up to then can be saved, or why finish() could not
  /// save; empty: nothing. In the thread that calls finish().
  std::string failure() const;

 private:
  /// What is looked after every now and then, by wall time, because the simulated clock of a bag may stand
  /// still.
  struct Watch {
    WorkQueue::Clock::time_point start = WorkQueue::Clock::now();
    WorkQueue::Clock::time_point last_look = start;
    WorkQueue::Clock::time_point last_warning = start;
    WorkQueue::Clock::time_point item_arrival = start;
    std::map<std::string, std::uint64_t> warned_turned_away;
  };

  void connectSystem();
  /// `pose_topic`: initialpose as it is resolved, for messages.
  void subscribe(const std::string& pose_topic);
  template <typename Message>
  void listenToMeasurements(const std::string& topic, Stream stream);
  Services::Actions actions();
  void handleTransforms(tf2_msgs::TFMessage message, bool is_static, bool of_this_process);
  void process(WorkQueue::Item& item);
  void tend(bool is_pause);
  void handleOutput(const Output& output, bool is_frame);
  void handleReset(const std::string& reason, const PathEstimate& path);
  std::string setPose(const geometry_msgs::PoseWithCovarianceStamped& message);
  std::string setState(const SetState::Request& request);
  void noteArrival(Stream stream, const ros::Time& stamp);
  void warn();
  RunSummary summary() const;

  NodeSettings settings_;
  MapStore maps_;
  SlamSystem system_;
  Intake intake_;
  OutputSequencer sequencer_;
  Publishers publishers_;
  Worker worker_;
  Diagnostics diagnostics_;
  Results results_;
  Watch watch_;
  ArrivalCheck arrival_check_;
  Subscriptions subscriptions_;
  std::unique_ptr<Services> services_; ///< none after finish()
};

} // namespace vi_ekf_slam
