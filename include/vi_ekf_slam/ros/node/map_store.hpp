#pragma once

#include <ros/ros.h>

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/map/saved_map.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam {

/// Where a node's map is saved, and what it starts with. Functions that write or read files may be called in
/// any thread.
class MapStore {
 public:
  struct Settings {
    std::string output_dir; ///< absolute; empty: nothing is saved
    std::string map_file;   ///< absolute, the map to relocalise in; empty: none
    bool resume = false;    ///< go on from output_dir/map.bag, and keep it up to date
    std::string map_frame;
  };

  explicit MapStore(Settings settings) : settings_(std::move(settings)) {}

  /// Gives `system` what the settings want it to start with. What an earlier run left is moved to
  /// output_dir/before_resume_N before it is resumed from; a map.bag that cannot be read is set aside with a
  /// warning. Throws MapError for ~map_file, and std::runtime_error where files cannot be moved.
  void begin(SlamSystem& system);

  /// output_dir/map.bag.
  std::string savedPath() const;
  /// Where a map is read from that nobody names: ~map_file, or output_dir/map.bag.
  std::string source() const;
  /// The map in `file`, or where that is empty in source(). Throws MapError.
  std::shared_ptr<const SavedMap> load(const std::string& file) const;
  /// The map of this file is going to be the one to be relocalised in. Where map.bag of output_dir is, and is
  /// kept up to date, a copy goes to before_resume_N. Throws std::runtime_error where that cannot be made.
  void noteLoaded(const std::string& file);

  /// Whether map.bag is to be kept up to date without being asked for.
  bool keepsSaved() const { return settings_.resume || asked_for_; }
  /// Of the estimator now, to be written to `path`: empty where it has none, or would put one that is not
  /// relocalised in the place of the map that it is to be relocalised in.
  std::function<SavedMap()> snapshot(const Estimator& estimator, const std::string& path) const;
  /// Computes and writes the map. Throws MapError.
  void write(const std::function<SavedMap()>& snapshot, const std::string& path);
  /// From now on keepsSaved().
  void askFor() { asked_for_ = true; }

 private:
  std::shared_ptr<const SavedMap> readOrSetAside() const;
  void resume(SlamSystem& system, const std::shared_ptr<const SavedMap>& map) const;

  Settings settings_;
  std::mutex writing_;
  mutable std::mutex loaded_mutex_;
  std::string loaded_; ///< file
  std::atomic<bool> asked_for_{false};
};

} // namespace vi_ekf_slam
