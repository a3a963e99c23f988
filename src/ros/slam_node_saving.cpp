// What SlamNode writes while it runs.

#include "vi_ekf_slam/ros/slam_node.hpp"

namespace vi_ekf_slam {

std::function<SavedMap()> SlamNode::mapToKeep() const {
  return maps_.keepsSaved() ? maps_.snapshot(system_.estimator()) : nullptr;
}

/// Writes a copy beside the work; a slow disk makes the next one late, not the estimate.
void SlamNode::autosave() {
  if (autosave_.valid() && autosave_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
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
  writer.writeMap(directory, landmarks);
  writer.writeSummary(directory, summary, landmarks.size());
}

RunSummary SlamNode::summary() const {
  return {"topics", settings_.source, secondsSince(start_), system_.counts(), diagnostics_.allTurnedAway()};
}

bool SlamNode::saveService(const std::function<void()>& write, std_srvs::Trigger::Response& response) {
  response.success = 0;
  if (settings_.output_dir.empty()) {
    response.message = "nothing saved: set " + private_nh_.resolveName("output_dir") + " and restart";
    return true;
  }
  try {
    const bool done = runInWorker([&] {
      if (autosave_.valid()) autosave_.wait(); // it writes the same files
      write();
    });
    response.success = done ? 1 : 0;
    response.message = done ? "saved in " + settings_.output_dir : "nothing saved: the node is ending";
  } catch (const std::exception& e) {
    response.message = e.what();
  }
  return true;
}

bool SlamNode::serveSaveTrajectory(std_srvs::Trigger::Request& /*request*/,
                                   std_srvs::Trigger::Response& response) {
  return saveService([this] { writer_.writeTrajectory(settings_.output_dir); }, response);
}

bool SlamNode::serveSaveMap(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  std::function<SavedMap()> map;
  saveService(
      [&] {
        writer_.writeMap(settings_.output_dir, system_.estimator().exactLandmarks());
        map = maps_.snapshot(system_.estimator());
      },
      response);
  if (!response.success) return true;
  if (!map) {
    response.message +=
        ", but no map.bag: the estimator keeps no joint covariance yet, or is not relocalised in what it "
        "loaded";
    return true;
  }
  try {
    maps_.write(map); // in this thread: the exact covariance takes its time
    maps_.askFor();
  } catch (const std::exception& e) {
    response.success = 0;
    response.message = e.what();
  }
  return true;
}

} // namespace vi_ekf_slam
