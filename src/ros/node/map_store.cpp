#include "vi_ekf_slam/ros/node/map_store.hpp"

#include <filesystem>
#include <stdexcept>
#include <system_error>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/run/run_writer.hpp"
#include "vi_ekf_slam/ros/map_file.hpp"

namespace vi_ekf_slam {
namespace {

namespace fs = std::filesystem;

constexpr char kBeforeResume[] = "before_resume_", kBroken[] = "map_broken_";

bool isSame(const std::string& a, const std::string& b) {
  std::error_code none; // of a path that is no file, as an empty one
  return fs::weakly_canonical(a, none) == fs::weakly_canonical(b, none);
}

fs::path numbered(const fs::path& directory, const char* stem, int number, const char* extension) {
  return directory / (stem + std::to_string(number) + extension);
}

/// The first number that is not taken.
int firstFree(const fs::path& directory, const char* stem, const char* extension) {
  int number = 1;
  while (fs::exists(fs::symlink_status(numbered(directory, stem, number, extension)))) ++number;
  return number;
}

/// What an earlier run left in `directory` beside its map.
std::vector<fs::path> earlierResults(const fs::path& directory) {
  if (!fs::exists(directory)) return {};
  std::vector<fs::path> results;
  for (const char* name : RunWriter::kFiles) {
    if (fs::exists(directory / name)) results.push_back(directory / name);
  }
  for (const auto& entry : fs::directory_iterator(directory)) {
    if (entry.path().filename().string().rfind(RunWriter::kBeforeReset, 0) == 0)
      results.push_back(entry.path());
  }
  return results;
}

/// Moves `results` into a new folder; map.bag of `directory` stays, and is there too. Respawned before it has
/// left anything, an earlier run has left nothing to be moved.
void keepEarlier(const fs::path& directory, const std::vector<fs::path>& results) {
  const fs::path map = directory / kMapFileName;
  const int number = firstFree(directory, kBeforeResume, "");
  const fs::path last = numbered(directory, kBeforeResume, number - 1, "") / kMapFileName;
  const bool map_is_kept = !fs::exists(map) || (fs::exists(last) && fs::equivalent(last, map));
  if (results.empty() && map_is_kept) return;
  const fs::path folder = numbered(directory, kBeforeResume, number, "");
  fs::create_directory(folder);
  for (const fs::path& path : results) fs::rename(path, folder / path.filename());
  std::error_code no_links;
  if (fs::exists(map)) fs::create_hard_link(map, folder / kMapFileName, no_links);
  if (no_links) fs::copy_file(map, folder / kMapFileName);
  ROS_INFO_STREAM("what was saved before is kept in " << folder.string());
}

} // namespace

std::string MapStore::savedPath() const { return (fs::path(settings_.output_dir) / kMapFileName).string(); }

std::string MapStore::source() const {
  return settings_.map_file.empty() && !settings_.output_dir.empty() ? savedPath() : settings_.map_file;
}

std::shared_ptr<const SavedMap> MapStore::load(const std::string& file) const {
  const std::string path = file.empty() ? source() : file;
  if (path.empty()) throw MapError("no map to load: give a file, or set map_file or output_dir and restart");
  return std::make_shared<const SavedMap>(readMapFile(path));
}

/// In place of map.bag the map of now is soon saved.
void MapStore::noteLoaded(const std::string& file) {
  if (settings_.resume && isSame(file, savedPath())) keepEarlier(settings_.output_dir, {});
  const std::lock_guard<std::mutex> lock(loaded_mutex_);
  loaded_ = file;
}

/// A broken file must not end the node again and again where something respawns it.
std::shared_ptr<const SavedMap> MapStore::readOrSetAside() const {
  if (!fs::exists(savedPath())) return nullptr;
  try {
    return std::make_shared<const SavedMap>(readMapFile(savedPath()));
  } catch (const MapError& e) {
    const int number = firstFree(settings_.output_dir, kBroken, ".bag");
    const fs::path aside = numbered(settings_.output_dir, kBroken, number, ".bag");
    fs::rename(savedPath(), aside);
    ROS_ERROR_STREAM("not resumed: " << e.what() << "; it is kept as " << aside.string());
    return nullptr;
  }
}

void MapStore::begin(SlamSystem& system) {
  const auto saved = settings_.resume ? readOrSetAside() : nullptr;
  const auto map =
      saved || settings_.map_file.empty() ? saved : load({}); // may throw: before anything is moved
  if (settings_.resume) {
    keepEarlier(settings_.output_dir, earlierResults(settings_.output_dir));
    system.keepMap();
  }
  if (saved) {
    resume(system, saved);
    return;
  }
  if (!map) return;
  system.loadMap(map, source());
  noteLoaded(source());
  ROS_INFO_STREAM("looking for the place in " << source() << ", with " << map->landmarks.size()
                                              << " landmarks");
}

/// A map of another motion model is good for finding the place in it.
void MapStore::resume(SlamSystem& system, const std::shared_ptr<const SavedMap>& map) const {
  const std::size_t count = map->landmarks.size();
  try {
    system.resumeFrom(map, savedPath());
    ROS_INFO_STREAM("resuming from " << savedPath() << " with " << count << " landmarks");
  } catch (const MapError& e) {
    system.loadMap(map, savedPath());
    ROS_WARN_STREAM("not resumed, but looking for the place among its " << count
                                                                        << " landmarks: " << e.what());
  }
}

std::function<SavedMap()> MapStore::snapshot(const Estimator& estimator, const std::string& path) const {
  const std::lock_guard<std::mutex> lock(loaded_mutex_);
  const bool is_kept = settings_.resume && isSame(path, savedPath()); // in before_resume_N
  const bool would_replace = isSame(path, loaded_) && !is_kept;
  if (estimator.mapUse() == MapUse::kWaiting && would_replace) return {};
  return estimator.savedMap();
}

void MapStore::write(const std::function<SavedMap()>& snapshot, const std::string& path) {
  const std::lock_guard<std::mutex> lock(writing_);
  writeMapFile(path, snapshot(), settings_.map_frame);
}

} // namespace vi_ekf_slam
