#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace vi_ekf_slam::simulation {

/// Writes an array in C order as a NumPy .npy file, format version 1.0. The product of `shape` must be the
/// number of values. Throws std::runtime_error that names the file when it cannot be written in full.
template <class T> // double or std::int64_t
void writeNpy(const std::string& path, const std::vector<T>& values, const std::vector<std::size_t>& shape);

} // namespace vi_ekf_slam::simulation
