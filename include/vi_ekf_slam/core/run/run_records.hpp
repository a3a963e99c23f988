#pragma once

#include <array>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam {

/// What is kept of one Output: plain numbers, so that a record can lie in a file as it is.
struct RunRecord {
  Stamp stamp = 0;
  std::array<double, 12> world_T_imu{};     ///< rotation column by column, translation (m)
  std::array<double, 12> odom_T_imu{};      ///< likewise
  std::array<double, 36> pose_covariance{}; ///< StateEstimate's
  FrameReport report;
  double update_s = 0.0;
};

/// An unnamed temporary file of records, that is only appended to: what was appended may be read in other
/// threads.
class RecordSpool {
 public:
  /// `directory`: where it is made with the first records, and made itself; empty: where temporary files are.
  explicit RecordSpool(std::string directory = {}) : directory_(std::move(directory)) {}
  /// Returns where they are. Throws std::runtime_error where no temporary file can be made or written.
  std::size_t append(const std::vector<RunRecord>& records);
  /// `records.size()` of them. Throws std::runtime_error.
  void read(std::size_t position, std::vector<RunRecord>& records) const;

 private:
  std::string directory_;
  std::shared_ptr<std::FILE> file_;
  std::size_t size_ = 0; ///< records
};

/// The records of a run of any length in a bounded memory: all but the newest are in a spool, which runs
/// share. Copies are cheap; each has the records up to when it was made, and may be read in another thread
/// while the original grows.
class RunRecords {
 public:
  explicit RunRecords(std::shared_ptr<RecordSpool> spool) : spool_(std::move(spool)) {}

  /// Throws std::runtime_error where the spool cannot be written: this record is lost, the next one tries it
  /// again.
  void add(const RunRecord& record);
  /// Nothing more comes: nothing stays in memory.
  void close();
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  /// s from the first to the last stamp; 0 without any.
  double seconds() const { return secondsBetween(first_stamp_, last_stamp_); }
  /// s; 0 without any.
  Eigen::Vector2d firstAndLast() const { return {toSeconds(first_stamp_), toSeconds(last_stamp_)}; }
  /// All records in order. Throws std::runtime_error where the spool cannot be read.
  void forEach(const std::function<void(const RunRecord&)>& visit) const;

 private:
  struct Chunk {
    std::size_t position, count;
  };

  std::shared_ptr<RecordSpool> spool_;
  std::vector<Chunk> spooled_;
  std::vector<RunRecord> recent_;
  std::size_t size_ = 0;
  Stamp first_stamp_ = 0, last_stamp_ = 0;
};

} // namespace vi_ekf_slam
