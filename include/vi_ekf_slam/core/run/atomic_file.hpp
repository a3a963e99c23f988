#pragma once

#include <fstream>
#include <string>

namespace vi_ekf_slam {

/// Renames a file within its folder, in the place of what has the name, once it is on the disk: neither a
/// kill nor a loss of power leaves half of it under the name. Throws std::runtime_error with `to` and cause.
void renameDurably(const std::string& from, const std::string& to);

/// A file that appears under its name only when it is complete: written under a temporary name beside it,
/// then renamed. Not committed, it leaves nothing.
class AtomicFile {
 public:
  explicit AtomicFile(const std::string& path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  AtomicFile& operator<<(const std::string& text) {
    file_ << text;
    return *this;
  }

  /// Throws std::runtime_error with path and cause where anything could not be written.
  void commit();

 private:
  std::string path_;
  std::string temporary_;
  std::ofstream file_;
};

/// An AtomicFile of this text.
void writeFile(const std::string& path, const std::string& text);

} // namespace vi_ekf_slam
