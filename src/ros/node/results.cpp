#include "vi_ekf_slam/ros/node/results.hpp"

#include <algorithm>
#include <exception>
#include <filesystem>
#include <memory>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/ros/map_file.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kAutosaveCost = 10.0; // of what the last one took, between two

template <class Future>
bool isDone(const Future& future) {
  return future.valid() && future.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
}

/// Does it; returns and logs why it could not.
std::string attempt(const std::function<void()>& save) {
  try {
    save();
  } catch (const std::exception& e) {
    const std::string failure = std::string("not saved: ") + e.what();
    ROS_ERROR_STREAM(failure);
    return failure;
  }
  return {};
}

} // namespace

Results::Results(const NodeSettings& settings, MapStore& maps, const SlamSystem& system, Worker& worker,
                 std::function<RunSummary()> summary)
    : output_dir_(settings.maps.output_dir),
      autosave_period_s_(settings.autosave_period_s),
      maps_(maps),
      system_(system),
      worker_(worker),
      summary_(std::move(summary)),
      writer_(settings.maps.output_dir) {}

/// The estimate is of use to others, whatever becomes of its record.
void Results::add(const Output& output, bool is_frame) {
  if (output_dir_.empty()) return;
  try {
    if (is_frame) {
      writer_.addFrame(output);
    } else {
      writer_.addGyro(output);
    }
  } catch (const std::runtime_error& e) {
    const std::string failure = std::string("not all poses are saved: ") + e.what();
    if (lost_.empty()) ROS_ERROR_STREAM(failure);
    noteLoss(failure);
  }
}

void Results::noteLoss(const std::string& failure) {
  if (lost_.empty()) lost_ = failure;
}

void Results::keepEarlierMap(const std::function<SavedMap()>& map) {
  if (!map || output_dir_.empty() || writer_.empty() || !maps_.keepsSaved()) return;
  finishEarlierMap(); // of the last reset: one at a time is in memory
  earlier_map_ = std::async(std::launch::async, [this, map, folder = writer_.nextEarlier(output_dir_)] {
    return attempt([&] {
      RunWriter::makeDirectory(folder);
      maps_.write(map, (std::filesystem::path(folder) / kMapFileName).string());
    });
  });
}

void Results::finishEarlierMap() {
  if (earlier_map_.valid()) noteLoss(earlier_map_.get());
}

std::function<SavedMap()> Results::mapToKeep() const {
  return maps_.keepsSaved() ? maps_.snapshot(system_.estimator(), maps_.savedPath()) : nullptr;
}

/// Writes a copy beside the work; a slow disk makes the next one late, not the estimate.
void Results::autosaveIfDue() {
  if (isDone(earlier_map_)) finishEarlierMap();
  if (output_dir_.empty() || autosave_period_s_ == 0.0 || service_saves_) return;
  if (autosave_.valid()) {
    if (!isDone(autosave_)) return;
    autosave_failure_ = autosave_.get();
  }
  // After a day the files are large: saving takes a tenth of the time at most.
  if (secondsSince(last_autosave_) < std::max(autosave_period_s_, kAutosaveCost * autosave_cost_s_)) return;
  last_autosave_ = WorkQueue::Clock::now();
  const auto files = std::make_shared<std::promise<void>>();
  autosaved_files_ = files->get_future();
  autosave_ = std::async(std::launch::async,
                         [this, files, writer = writer_, summary = summary_(),
                          estimate = MapEstimate{system_.estimator().landmarks(), system_.estimator().path()},
                          map = mapToKeep()] {
                           const auto start = WorkQueue::Clock::now();
                           std::string failure =
                               attempt([&] { writer.write(output_dir_, summary, estimate); });
                           files->set_value();
                           if (failure.empty() && map)
                             failure = attempt([&] { maps_.write(map, maps_.savedPath()); });
                           autosave_cost_s_ = secondsSince(start);
                           return failure;
                         });
}

/// What `snapshot` returns writes, in this thread: neither the computing nor the disk keeps the worker
/// waiting.
Results::Answer Results::save(const Snapshot& snapshot) {
  Answer answer;
  try {
    std::function<std::string()> write;
    std::shared_future<std::string> autosave;
    const bool done = worker_.run([&] {
      write = snapshot();
      autosave = autosave_;
      service_saves_ = true;
    });
    if (done && autosave.valid()) autosave.wait(); // it writes the same files
    answer.message = done ? write() : "nothing saved: the node is ending";
    answer.success = done;
  } catch (const std::exception& e) {
    answer.message = e.what();
  }
  service_saves_ = false;
  return answer;
}

/// Nothing does not take the place of what an earlier run has left.
void Results::requireMeasurements(const std::string& path) const {
  const auto processed = system_.counts().processed;
  if (std::accumulate(processed.begin(), processed.end(), std::uint64_t{0}) == 0)
    throw std::runtime_error("nothing saved in " + path + ": no measurement has been processed yet");
}

Results::Answer Results::saveTrajectory() {
  if (output_dir_.empty()) return {false, "nothing saved: set ~output_dir and restart"};
  return save([this] {
    requireMeasurements(output_dir_);
    return [this, writer = writer_, path = system_.estimator().path()] {
      writer.writeTrajectory(output_dir_);
      writer.writeSmoothed(output_dir_, path);
      return "saved in " + output_dir_;
    };
  });
}

Results::Answer Results::saveMap(const std::string& file) {
  if (file.empty() && output_dir_.empty())
    return {false, "nothing saved: give a file, or set ~output_dir and restart"};
  const std::string path = file.empty() ? maps_.savedPath() : file;
  return save([this, path, in_output_dir = file.empty()] {
    requireMeasurements(path);
    return [this, path, in_output_dir, joint_map = maps_.snapshot(system_.estimator(), path),
            exact = system_.estimator().exactMap()]() mutable {
      std::string also;
      if (in_output_dir) {
        RunWriter::writeMap(output_dir_, exact().landmarks);
        also = std::string(", but ") + RunWriter::kLandmarks + " in " + output_dir_;
      }
      exact = nullptr; // lets go of what would have to be copied for joint_map to change it
      if (!joint_map)
        throw std::runtime_error(
            "no " + path + also +
            ": the estimator keeps no joint covariance (yet), or is not relocalised in the "
            "map that it would replace");
      maps_.write(joint_map, path);
      if (in_output_dir) maps_.askFor();
      return "saved " + path;
    };
  });
}

/// Who ends the node may kill it before long: the poses come first, and what takes longer after them.
void Results::saveAtTheEnd() {
  if (output_dir_.empty()) return;
  if (autosaved_files_.valid()) autosaved_files_.wait(); // it writes the same ones; its map can take long
  failure_ = attempt([this] {
    writer_.write(output_dir_, summary_(), {system_.estimator().landmarks(), system_.estimator().path()});
    const MapEstimate exact = system_.estimator().exactMap()();
    RunWriter::writeMap(output_dir_, exact.landmarks);
    writer_.writeSmoothed(output_dir_, exact.path);
  });
  if (autosave_.valid()) autosave_.wait();
  finishEarlierMap();
  if (failure_.empty()) {
    failure_ = attempt([this] {
      if (const auto map = mapToKeep()) maps_.write(map, maps_.savedPath());
      ROS_INFO_STREAM("saved " << writer_.size() << " poses in " << output_dir_);
    });
  }
  if (failure_.empty()) failure_ = lost_;
}

} // namespace vi_ekf_slam
