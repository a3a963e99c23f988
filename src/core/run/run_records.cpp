#include "vi_ekf_slam/core/run/run_records.hpp"

#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <type_traits>

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kChunk = 256; // records in memory at most

static_assert(std::is_trivially_copyable_v<RunRecord>);

[[noreturn]] void fail(const char* what) {
  throw std::runtime_error(std::string("temporary file of the run's results: ") + what + ": " +
                           std::strerror(errno));
}

/// A file without a name: it goes with the process, however that ends.
std::FILE* makeFile(const std::string& directory) {
  namespace fs = std::filesystem;
  if (!directory.empty()) fs::create_directories(directory);
  const fs::path folder = directory.empty() ? fs::temp_directory_path() : fs::path(directory);
  std::string name = (folder / ".vi_ekf_slam_XXXXXX").string();
  const int file = mkostemp(name.data(), O_CLOEXEC);
  if (file < 0) fail("cannot be made");
  unlink(name.c_str());
  return fdopen(file, "w+b");
}

/// read or write of all of `bytes`, by pread or pwrite: those need no common position.
template <typename Call, typename Byte>
void transfer(Call call, std::FILE* file, Byte* data, std::size_t bytes, std::size_t offset,
              const char* what) {
  for (std::size_t done = 0; done < bytes;) {
    const ssize_t n = call(fileno(file), data + done, bytes - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) fail(what);
    done += static_cast<std::size_t>(n);
  }
}

} // namespace

std::size_t RecordSpool::append(const std::vector<RunRecord>& records) {
  if (!file_) {
    std::FILE* file = makeFile(directory_);
    if (file == nullptr) fail("cannot be made");
    file_.reset(file, [](std::FILE* f) { std::fclose(f); });
  }
  const std::size_t position = size_;
  transfer(pwrite, file_.get(), reinterpret_cast<const char*>(records.data()),
           records.size() * sizeof(RunRecord), position * sizeof(RunRecord), "cannot be written");
  size_ += records.size();
  return position;
}

void RecordSpool::read(std::size_t position, std::vector<RunRecord>& records) const {
  transfer(pread, file_.get(), reinterpret_cast<char*>(records.data()), records.size() * sizeof(RunRecord),
           position * sizeof(RunRecord), "cannot be read");
}

void RunRecords::add(const RunRecord& record) {
  if (recent_.size() == kChunk) close();
  recent_.push_back(record);
  if (size_++ == 0) first_stamp_ = record.stamp;
  last_stamp_ = record.stamp;
}

void RunRecords::close() {
  if (recent_.empty()) return;
  spooled_.push_back({spool_->append(recent_), recent_.size()});
  recent_.clear();
}

void RunRecords::forEach(const std::function<void(const RunRecord&)>& visit) const {
  std::vector<RunRecord> records;
  for (const Chunk& chunk : spooled_) {
    records.resize(chunk.count);
    spool_->read(chunk.position, records);
    std::for_each(records.begin(), records.end(), visit);
  }
  std::for_each(recent_.begin(), recent_.end(), visit);
}

} // namespace vi_ekf_slam
