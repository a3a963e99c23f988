#pragma once

#include <string>

#include "vi_ekf_slam/core/map/saved_map.hpp"

namespace vi_ekf_slam {

/// Name of the file in an output folder.
constexpr char kMapFileName[] = "map.bag";

/// Checks the map and writes it as a bag of MapState, MapLandmark and MapDescriptors, which appears under its
/// name only when it is whole and on the disk. Throws MapError.
void writeMapFile(const std::string& path, const SavedMap& map, const std::string& map_frame);

/// The map in a bag of writeMapFile, checked. Memory is bounded by the file's size and kMaxSavedLandmarks,
/// whatever the file says. Throws MapError.
SavedMap readMapFile(const std::string& path);

} // namespace vi_ekf_slam
