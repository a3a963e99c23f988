#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace vi_ekf_slam {

/// A bag that cannot be used, wholly or from some point on; what() names the bag and the cause.
class BagError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Who sent messages of which type on which topic.
struct BagConnection {
  std::string topic, type, md5;
};

/// A message as it was sent; valid until the next one is read.
struct BagMessage {
  const BagConnection& connection;
  const std::uint8_t* data;
  std::uint32_t size; ///< bytes
  std::uint64_t time; ///< ns, of recording
};

/// Reads bags of format 2.0 that nobody vouches for. rosbag::Bag believes what a file says, and with one that
/// is damaged or made to harm it reads beyond its buffers, asks for any amount of memory, or loads the plugin
/// that the bag names. This one holds the index and one chunk, which the file's size bounds, and reads each
/// chunk once where their times do not overlap.
class BagReader {
 public:
  /// Reads the index, not what the chunks hold. Throws BagError.
  explicit BagReader(const std::string& path);
  ~BagReader();

  /// By their ids; also those without messages.
  const std::map<std::uint32_t, BagConnection>& connections() const { return connections_; }
  /// Messages of the topic.
  std::size_t count(const std::string& topic) const { return entriesOf({topic}).size(); }
  /// Calls `visit` with the messages of these topics in the order of their times of recording, those of one
  /// time in that of the file, and the share of them that is done with each (to 1), until it returns false.
  /// Throws BagError where the bag cannot be read on, and what `visit` throws.
  void forEach(const std::set<std::string>& topics,
               const std::function<bool(const BagMessage&, double)>& visit);

 private:
  class File;
  struct Entry {
    std::uint64_t time;               ///< ns
    std::uint64_t chunk;              ///< its position in the file, bytes
    std::uint32_t offset, connection; ///< offset within the unpacked chunk, bytes
  };

  void readIndex();
  std::vector<Entry> entriesOf(const std::set<std::string>& topics) const;
  void readEntries(std::uint64_t chunk, std::uint32_t connection, std::uint32_t count, std::uint32_t bytes);
  void readChunk(std::uint64_t position);
  BagMessage messageOf(const Entry& entry);

  std::string path_;
  std::unique_ptr<File> file_;
  std::map<std::uint32_t, BagConnection> connections_;
  std::vector<Entry> entries_;
  std::uint64_t chunk_position_ = 0; ///< of chunk_; 0: none
  std::vector<char> chunk_;          ///< unpacked
};

} // namespace vi_ekf_slam
