#pragma once

#include <atomic>
#include <functional>
#include <future>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/run/run_writer.hpp"
#include "vi_ekf_slam/ros/node/map_store.hpp"
#include "vi_ekf_slam/ros/node/settings.hpp"
#include "vi_ekf_slam/ros/node/worker.hpp"

namespace vi_ekf_slam {

/// What a node has computed, and how it comes to the disk: at the end, every now and then, and when it is
/// asked for. Copies are made in the worker, and written beside it; one thread at a time
/// writes a file.
class Results {
 public:
  struct Answer {
    bool success = false;
    std::string message;
  };

  /// What is saved of; must outlive this.
  Results(const NodeSettings& settings, MapStore& maps, const SlamSystem& system, Worker& worker,
          std::function<RunSummary()> summary);

  // In the worker.
  void add(const Output& output, bool is_frame);
  /// Before a restart: writes the map to the folder that the earlier poses go to, beside the work, where
  /// map.bag is kept up to date. Empty: there is none.
  void keepEarlierMap(const std::function<SavedMap()>& map);
  /// Earlier poses are in another frame, or of another start.
  void restart(std::optional<PathEstimate> path = std::nullopt) { writer_.restart(std::move(path)); }
  void autosaveIfDue();
  /// Why something is not saved; empty: nothing is missing.
  const std::string& problem() const { return lost_.empty() ? autosave_failure_ : lost_; }

  // In any other thread.
  Answer saveTrajectory();
  /// `file`: absolute; empty: map.bag of output_dir, and landmarks.csv. From then on both are kept up to
  /// date.
  Answer saveMap(const std::string& file);

  /// The worker has ended: saves everything, and says so.
  void saveAtTheEnd();
  /// Why something is not saved after saveAtTheEnd(); empty: all is. In its thread.
  const std::string& failure() const { return failure_; }

 private:
  /// Made in the worker; what it returns computes and writes, in any thread, and says what it wrote.
  using Snapshot = std::function<std::function<std::string()>()>;

  Answer save(const Snapshot& snapshot);
  void requireMeasurements(const std::string& path) const;
  void noteLoss(const std::string& failure);
  void finishEarlierMap();
  std::function<SavedMap()> mapToKeep() const;

  std::string output_dir_;
  double autosave_period_s_;
  MapStore& maps_;
  const SlamSystem& system_;
  Worker& worker_;
  std::function<RunSummary()> summary_;
  RunWriter writer_;
  WorkQueue::Clock::time_point last_autosave_ = WorkQueue::Clock::now();
  std::shared_future<std::string> autosave_; ///< why it could not
  std::future<void> autosaved_files_;        ///< of it: all but the map
  std::string autosave_failure_;             ///< of the one before
  std::future<std::string> earlier_map_;     ///< why it could not be written
  std::string lost_;                         ///< why, of what no later autosave can save; the first
  std::atomic<double> autosave_cost_s_{0.0}; ///< s of wall time that the last one took
  std::atomic<bool> service_saves_{false};   ///< set by the worker: no autosave begins
  std::string failure_;
};

} // namespace vi_ekf_slam
