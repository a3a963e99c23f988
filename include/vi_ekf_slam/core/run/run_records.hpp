#pragma once

#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// An unnamed temporary file, only appended to: what was appended may be read in other threads.
class TextSpool {
 public:
  /// Returns where it is. Throws std::runtime_error where no temporary file can be made or written.
  std::size_t append(const std::string& text);
  /// Fills `text`. Throws std::runtime_error.
  void read(std::size_t position, std::string& text) const;

 private:
  std::shared_ptr<std::FILE> file_;
  std::size_t size_ = 0; ///< bytes
};

/// The records of a run of any length, as text, in a bounded memory: all but the newest are in a spool, which
/// runs share. Copies are cheap; each has the records up to when it was made, and may be read in another
/// thread while the original grows.
class RunRecords {
 public:
  explicit RunRecords(std::shared_ptr<TextSpool> spool) : spool_(std::move(spool)) {}

  /// Throws std::runtime_error where the spool cannot be written.
  void add(Stamp stamp, const std::string& text);
  /// Nothing more comes: nothing stays in memory.
  void close();
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  /// s from the first to the last stamp; 0 without any.
  double seconds() const { return secondsBetween(first_stamp_, last_stamp_); }
  /// The text of all in order, some records at a time. Throws std::runtime_error where it cannot be read.
  void forEach(const std::function<void(const std::string&)>& visit) const;

 private:
  struct Chunk {
    std::size_t position, bytes;
  };

  std::shared_ptr<TextSpool> spool_;
  std::vector<Chunk> spooled_;
  std::string recent_;
  std::size_t size_ = 0;
  Stamp first_stamp_ = 0, last_stamp_ = 0;
};

} // namespace vi_ekf_slam
