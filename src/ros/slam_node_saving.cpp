// What SlamNode writes while it runs: from copies, beside the work, and one thread at a time.

#include <algorithm>
#include <utility>

#include "vi_ekf_slam/ros/slam_node.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kAutosaveCost = 10.0; // of what the last one took, between two

} // namespace

std::function<SavedMap()> SlamNode::mapToKeep() const {
  return maps_.keepsSaved() ? maps_.snapshot(system_.estimator()) : nullptr;
}

bool SlamNode::isAutosaveDue() const {
  const double period = settings_.autosave_period_s;
  if (settings_.output_dir.empty() || period == 0.0 || service_saves_ || intake_.received() == 0)
    return false;
  if (autosave_.valid() && autosave_.wait_for(std::chrono::seconds(0)) != std::future_status::ready)
    return false;
  // After a day the files are large: saving takes a tenth of the time at most.
  return secondsSince(last_autosave_) >= std::max(period, kAutosaveCost * autosave_cost_s_);
}

/// Writes a copy beside the work; a slow disk makes the next one late, not the estimate.
void SlamNode::autosave() {
  last_autosave_ = WorkQueue::Clock::now();
  autosave_ =
      std::async(std::launch::async, [this, writer = writer_, summary = summary(),
                                      landmarks = system_.estimator().landmarks(), map = mapToKeep()] {
        const auto start = WorkQueue::Clock::now();
        try {
          save(writer, settings_.output_dir, summary, landmarks);
          if (map) maps_.write(map);
        } catch (const std::exception& e) {
          ROS_ERROR_STREAM("not saved: " << e.what());
        }
        autosave_cost_s_ = secondsSince(start);
      });
}

void SlamNode::save(const RunWriter& writer, const std::string& directory, const RunSummary& summary,
                    const std::vector<LandmarkEstimate>& landmarks) {
  writer.writeTrajectory(directory);
  RunWriter::writeMap(directory, landmarks);
  writer.writeSummary(directory, summary, landmarks.size());
}

RunSummary SlamNode::summary() const {
  return {"topics",
          settings_.source,
          secondsSince(start_),
          system_.counts(),
          diagnostics_.allTurnedAway(),
          system_.noise().streams()};
}

/// What `snapshot` returns writes, in this thread: neither the computing nor the disk keeps the worker
/// waiting.
bool SlamNode::saveService(const Snapshot& snapshot, std_srvs::Trigger::Response& response) {
  response.success = 0;
  if (settings_.output_dir.empty()) {
    response.message = "nothing saved: set " + private_nh_.resolveName("output_dir") + " and restart";
    return true;
  }
  try {
    std::function<void()> write;
    std::shared_future<void> autosave;
    const bool done = runInWorker([&] {
      write = snapshot();
      autosave = autosave_;
      service_saves_ = true;
    });
    if (done) {
      if (autosave.valid()) autosave.wait(); // it writes the same files
      write();
    }
    response.success = done ? 1 : 0;
    response.message = done ? "saved in " + settings_.output_dir : "nothing saved: the node is ending";
  } catch (const std::exception& e) {
    response.message = e.what();
  }
  service_saves_ = false;
  return true;
}

bool SlamNode::serveSaveTrajectory(std_srvs::Trigger::Request& /*request*/,
                                   std_srvs::Trigger::Response& response) {
  const auto snapshot = [this] {
    return [this, writer = writer_] { writer.writeTrajectory(settings_.output_dir); };
  };
  return saveService(snapshot, response);
}

bool SlamNode::serveSaveMap(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  bool has_joint_map = false;
  const auto snapshot = [&] {
    auto joint_map = maps_.snapshot(system_.estimator());
    has_joint_map = joint_map != nullptr;
    return [this, joint_map = std::move(joint_map), landmarks = system_.estimator().exactMap()]() mutable {
      RunWriter::writeMap(settings_.output_dir, landmarks());
      landmarks = nullptr; // lets go of what would have to be copied for joint_map to change it
      if (!joint_map) return;
      maps_.write(joint_map);
      maps_.askFor();
    };
  };
  saveService(snapshot, response);
  if (response.success && !has_joint_map) {
    response.message +=
        ", but no map.bag: the estimator keeps no joint covariance yet, or is not relocalised in what it "
        "loaded";
  }
  return true;
}

} // namespace vi_ekf_slam
