#include "vi_ekf_slam/ros/output/bag_writer.hpp"

#include <cstdio>
#include <filesystem>
#include <system_error>

#include "vi_ekf_slam/core/run/atomic_file.hpp"

namespace vi_ekf_slam {

BagWriter::BagWriter(const std::string& path)
    : path_(path), temporary_(path + ".tmp"), bag_(std::make_unique<rosbag::Bag>()) {
  try {
    bag_->open(temporary_, rosbag::bagmode::Write);
  } catch (const std::exception& e) {
    abandon();
    fail(e);
  }
}

BagWriter::~BagWriter() {
  if (bag_) abandon();
}

void BagWriter::finish() {
  try {
    bag_->close();
    renameDurably(temporary_, path_);
  } catch (const std::exception& e) {
    fail(e);
  }
  bag_.reset();
}

/// A bag writes its index when it is closed, and its destructor closes it: what throws there ends the
/// program. An emptied file makes the room for it on a full disk.
void BagWriter::abandon() noexcept {
  std::error_code none;
  std::filesystem::resize_file(temporary_, 0, none);
  try {
    bag_->close();
    bag_.reset();
  } catch (const std::exception&) {
    static_cast<void>(bag_.release()); // not closed, it is not to be destroyed
  }
  std::remove(temporary_.c_str());
}

void BagWriter::fail(const std::exception& cause) const {
  throw BagWriteError(path_ + ": cannot be written: " + cause.what());
}

} // namespace vi_ekf_slam
