#include "vi_ekf_slam/core/atomic_file.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <stdexcept>

namespace vi_ekf_slam {

AtomicFile::AtomicFile(const std::string& path)
    : path_(path), temporary_(path + ".tmp"), file_(temporary_, std::ios::binary | std::ios::trunc) {}

AtomicFile::~AtomicFile() {
  if (temporary_.empty()) return;
  file_.close();
  std::remove(temporary_.c_str());
}

void AtomicFile::commit() {
  file_.close();
  if (!file_) throw std::runtime_error(path_ + ": cannot be written: " + std::strerror(errno));
  if (std::rename(temporary_.c_str(), path_.c_str()) != 0) {
    throw std::runtime_error(path_ + ": cannot be renamed into place: " + std::strerror(errno));
  }
  temporary_.clear();
}

} // namespace vi_ekf_slam
