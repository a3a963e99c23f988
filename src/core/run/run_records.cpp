#include "vi_ekf_slam/core/run/run_records.hpp"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kChunk = 1 << 18; // bytes in memory, about

[[noreturn]] void fail(const char* what) {
  throw std::runtime_error(std::string("temporary file of the run's results: ") + what + ": " +
                           std::strerror(errno));
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

std::size_t TextSpool::append(const std::string& text) {
  if (!file_) {
    std::FILE* file = std::tmpfile();
    if (file == nullptr) fail("cannot be made");
    file_.reset(file, [](std::FILE* f) { std::fclose(f); });
  }
  transfer(pwrite, file_.get(), text.data(), text.size(), size_, "cannot be written");
  return std::exchange(size_, size_ + text.size());
}

void TextSpool::read(std::size_t position, std::string& text) const {
  transfer(pread, file_.get(), text.data(), text.size(), position, "cannot be read");
}

void RunRecords::add(Stamp stamp, const std::string& text) {
  if (recent_.size() >= kChunk) close();
  recent_ += text;
  if (size_++ == 0) first_stamp_ = stamp;
  last_stamp_ = stamp;
}

void RunRecords::close() {
  if (recent_.empty()) return;
  spooled_.push_back({spool_->append(recent_), recent_.size()});
  recent_.clear();
}

void RunRecords::forEach(const std::function<void(const std::string&)>& visit) const {
  std::string text;
  for (const Chunk& chunk : spooled_) {
    text.resize(chunk.bytes);
    spool_->read(chunk.position, text);
    visit(text);
  }
  visit(recent_);
}

} // namespace vi_ekf_slam
