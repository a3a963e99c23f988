#include "vi_ekf_slam/core/run/atomic_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <stdexcept>

namespace vi_ekf_slam {
namespace {

/// fsync of a file or folder; a file system that has none for folders is not an error.
bool toDisk(const std::string& path) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return false;
  const bool done = fsync(file) == 0 || errno == EINVAL;
  const int error = errno;
  close(file);
  errno = error;
  return done;
}

} // namespace

void renameDurably(const std::string& from, const std::string& to) {
  if (!toDisk(from)) throw std::runtime_error(to + ": cannot be written: " + std::strerror(errno));
  if (std::rename(from.c_str(), to.c_str()) != 0)
    throw std::runtime_error(to + ": cannot be renamed into place: " + std::strerror(errno));
  const std::filesystem::path folder = std::filesystem::path(to).parent_path();
  toDisk(folder.empty() ? "." : folder.string());
}

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
  renameDurably(temporary_, path_);
  temporary_.clear();
}

void writeFile(const std::string& path, const std::string& text) {
  AtomicFile file(path);
  file << text;
  file.commit();
}

} // namespace vi_ekf_slam
