#pragma once

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <std_srvs/Empty.h>
#include <std_srvs/Trigger.h>

#include <atomic>
#include <functional>
#include <future>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "vi_ekf_slam/core/run/run_writer.hpp"
#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/node/diagnostics.hpp"
#include "vi_ekf_slam/ros/node/load_control.hpp"
#include "vi_ekf_slam/ros/node/map_store.hpp"
#include "vi_ekf_slam/ros/node/tuning.hpp"
#include "vi_ekf_slam/ros/node/work_queue.hpp"
#include "vi_ekf_slam/ros/output/output_sequencer.hpp"
#include "vi_ekf_slam/ros/output/publishers.hpp"

namespace vi_ekf_slam {

/// Connects topics, services and parameters to Intake, SlamSystem, Publishers and RunWriter.
///
/// Three threads: the callbacks of the topics (the node's or nodelet's queue) only put messages into a
/// WorkQueue; a worker takes them out, computes and publishes, and owns everything but that queue; services
/// have a thread of their own, hand their work to the worker and wait for it; what they save is a copy that
/// the worker makes, computed and written in their thread.
class SlamNode {
 public:
  /// Throws ConfigError, MapError for ~map_file, or std::runtime_error when output_dir cannot be made: the
  /// node must not start then.
  SlamNode(ros::NodeHandle nh, ros::NodeHandle private_nh);
  /// Calls finish().
  ~SlamNode();
  SlamNode(const SlamNode&) = delete;
  SlamNode& operator=(const SlamNode&) = delete;

  /// The data are over: processes what is still held (for a few seconds at most) and saves everything. A
  /// second call does nothing.
  void finish();

  /// What ended the computing early; empty: nothing. Everything up to then is saved.
  std::string failure() const;

 private:
  /// Made in the worker; what it returns computes and writes, in any thread.
  using Snapshot = std::function<std::function<void()>()>;

  struct Settings {
    FullConfig config;
    std::string source;              ///< where the parameters are, for messages
    std::string output_dir;          ///< absolute; empty: nothing is saved
    double autosave_period_s = 60.0; ///< s of wall time; 0: saved at the end only
    MapStore::Settings maps;
  };

  static Settings readSettings(const ros::NodeHandle& private_nh);
  static InputTopics resolvedTopics(const ros::NodeHandle& nh);

  std::function<SavedMap()> mapToKeep() const;
  void connectSystem();
  void subscribe();
  void advertiseServices();
  template <typename Message>
  void listen(const std::string& topic, std::function<void(const Message&)> process,
              std::optional<Stream> stream, const std::atomic<bool>* wanted = nullptr);
  template <typename Message>
  void listenToMeasurements(const std::string& topic, Stream stream);
  void handleTransforms(const tf2_msgs::TFMessage& message, bool is_static);
  void work();
  void process(WorkQueue::Item& item);
  void stopWork();
  bool tune(const TuningConfig& tuning);
  bool runInWorker(const std::function<void()>& task);
  void handleOutput(const Output& output, bool is_frame);
  void handleReset(const std::string& reason);
  void checkHealth();
  void warn();
  bool isAutosaveDue() const;
  void autosave();
  static void save(const RunWriter& writer, const std::string& directory, const RunSummary& summary,
                   const std::vector<LandmarkEstimate>& landmarks);
  RunSummary summary() const;
  bool saveService(const Snapshot& snapshot, std_srvs::Trigger::Response& response);
  bool serveReset(std_srvs::Empty::Request& request, std_srvs::Empty::Response& response);
  bool serveSaveTrajectory(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool serveSaveMap(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool serveLoadMap(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  ros::NodeHandle nh_;
  ros::NodeHandle private_nh_;
  Settings settings_;
  MapStore maps_;
  SlamSystem system_;
  Intake intake_;
  OutputSequencer sequencer_;
  Publishers publishers_;
  Diagnostics diagnostics_;
  RunWriter writer_;
  LoadControl load_;
  WorkQueue queue_;
  WorkQueue::Clock::time_point start_ = WorkQueue::Clock::now();
  WorkQueue::Clock::time_point last_health_ = start_;
  WorkQueue::Clock::time_point last_warning_ = start_;
  WorkQueue::Clock::time_point last_autosave_ = start_;
  std::shared_future<void> autosave_;
  std::atomic<double> autosave_cost_s_{0.0}; ///< s of wall time that the last one took
  std::atomic<bool> service_saves_{false};   ///< set by the worker: no autosave begins
  WorkQueue::Clock::time_point item_arrival_ = start_;
  std::map<std::string, std::uint64_t> warned_turned_away_;
  bool finished_ = false;
  mutable std::mutex failure_mutex_;
  std::string failure_;
  std::atomic<bool> abandon_{false};
  std::atomic<bool> transforms_wanted_{true}; ///< /tf is busy, with our own transforms too
  ros::CallbackQueue service_queue_;
  std::vector<ros::Subscriber> subscribers_;
  std::vector<ros::ServiceServer> services_;
  std::unique_ptr<Tuning> tuning_;
  ros::AsyncSpinner service_spinner_{1, &service_queue_};
  std::thread worker_;
};

} // namespace vi_ekf_slam
