// Format: http://wiki.ros.org/Bags/Format/2.0
#include "vi_ekf_slam/ros/input/bag_reader.hpp"

#include <bzlib.h>
#include <roslz4/lz4s.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <tuple>
#include <utility>

namespace vi_ekf_slam {
namespace bag_format { // has a name because BagReader::File is made of it

constexpr char kMagic[] = "#ROSBAG V2.0\n";
constexpr std::uint32_t kMaxHeader = 1 << 20; // bytes; the longest thing in one is a message's definition
// A compressed chunk unpacks to at most so many bytes, or so many times those that it has in the file.
constexpr std::uint64_t kMaxUnpacked = 64 << 20, kMaxRatio = 64;
constexpr std::uint32_t kIndexEntry = 12; // bytes: time, offset
enum Op : std::uint8_t { kMessage = 2, kBagHeader = 3, kIndex = 4, kChunk = 5, kConnection = 7 };

using Bytes = std::vector<char>;

[[noreturn]] void fail(const std::string& cause) { throw std::runtime_error(cause); }

/// Bytes in memory or in a file, from a position on.
class Source {
 public:
  virtual ~Source() = default;
  virtual std::uint64_t left() const = 0;
  virtual void read(void* to, std::size_t count) = 0; ///< `count` at most left()

  std::uint32_t length(const char* of, std::uint32_t limit = UINT32_MAX) {
    std::uint32_t value = 0;
    if (left() < sizeof(value)) fail("it ends within a record (cut short?)");
    read(&value, sizeof(value));
    if (value > left()) fail(std::string(of) + " goes beyond the end (cut short?)");
    if (value > limit) {
      fail(std::string(of) + " has " + std::to_string(value) + " bytes, allowed: at most " +
           std::to_string(limit));
    }
    return value;
  }
};

class MemorySource : public Source {
 public:
  MemorySource(const Bytes& bytes, std::size_t at) : bytes_(bytes), at_(at) {}
  std::uint64_t left() const override { return bytes_.size() - at_; }
  void read(void* to, std::size_t count) override {
    if (count > 0) std::memcpy(to, bytes_.data() + at_, count);
    at_ += count;
  }
  void skip(std::size_t count) { at_ += count; }
  const char* here() const { return bytes_.data() + at_; }

 private:
  const Bytes& bytes_;
  std::size_t at_;
};

/// The fields of a record's header.
class Fields {
 public:
  explicit Fields(Source& source) {
    Bytes header(source.length("a record's header", kMaxHeader));
    source.read(header.data(), header.size());
    for (MemorySource fields(header, 0); fields.left() > 0;) {
      std::string field(fields.length("a field of a record's header"), '\0');
      fields.read(field.data(), field.size());
      const std::size_t equals = field.find('=');
      if (equals == std::string::npos) fail("a field of a record's header has no name");
      values_[field.substr(0, equals)] = field.substr(equals + 1);
    }
  }

  template <typename T>
  T number(const char* name) const {
    const auto found = values_.find(name);
    if (found == values_.end() || found->second.size() != sizeof(T)) {
      fail(std::string("a record lacks the field '") + name + "'");
    }
    T value;
    std::memcpy(&value, found->second.data(), sizeof(T));
    return value;
  }
  std::uint8_t op() const { return number<std::uint8_t>("op"); }
  std::string text(const char* name) const {
    const auto found = values_.find(name);
    return found == values_.end() ? std::string() : found->second;
  }

 private:
  std::map<std::string, std::string> values_;
};

Bytes unpack(Bytes packed, const std::string& compression, std::uint32_t size) {
  if (compression == "none") {
    if (packed.size() != size) fail("a chunk is not as long as it says");
    return packed;
  }
  if (compression != "bz2" && compression != "lz4")
    fail("a chunk is compressed with '" + compression + "', allowed: none, bz2, lz4");
  const std::uint64_t limit = std::max(kMaxUnpacked, kMaxRatio * packed.size());
  if (size > limit) {
    fail("a chunk unpacks to " + std::to_string(size) + " bytes, allowed: at most " + std::to_string(limit));
  }
  Bytes content(std::max<std::size_t>(size, 1)); // never null
  unsigned int got = size;
  const auto length = static_cast<unsigned int>(packed.size());
  const bool good =
      compression == "bz2"
          ? BZ2_bzBuffToBuffDecompress(content.data(), &got, packed.data(), length, 0, 0) == BZ_OK
          : roslz4_buffToBuffDecompress(packed.data(), length, content.data(), &got) == ROSLZ4_OK;
  if (!good || got != size) fail("a chunk cannot be unpacked");
  content.resize(size);
  return content;
}

} // namespace bag_format

using bag_format::Bytes;
using bag_format::fail;
using bag_format::Fields;
using bag_format::MemorySource;

class BagReader::File : public bag_format::Source {
 public:
  explicit File(const std::string& path) : file_(path, std::ios::binary) {
    file_.seekg(0, std::ios::end);
    size_ = file_ ? static_cast<std::uint64_t>(file_.tellg()) : 0;
    seek(0);
    if (!file_) fail("cannot be read");
  }
  std::uint64_t left() const override { return size_ - at_; }
  std::uint64_t position() const { return at_; }
  void read(void* to, std::size_t count) override {
    if (!file_.read(static_cast<char*>(to), static_cast<std::streamsize>(count))) fail("cannot be read");
    at_ += count;
  }
  /// `position` at most the file's size.
  void seek(std::uint64_t position) {
    at_ = position;
    file_.seekg(static_cast<std::streamoff>(at_));
  }

 private:
  std::ifstream file_;
  std::uint64_t size_ = 0, at_ = 0;
};

BagReader::BagReader(const std::string& path) : path_(path) {
  if (!std::filesystem::exists(path)) throw BagError(path + ": no such file");
  if (!std::filesystem::is_regular_file(path)) throw BagError(path + ": is not a file");
  if (std::filesystem::file_size(path) == 0) throw BagError(path + ": is empty");
  try {
    file_ = std::make_unique<File>(path);
    readIndex();
  } catch (const std::exception& error) { // of memory too
    throw BagError(path + ": is not a bag that can be read: " + error.what());
  }
}

BagReader::~BagReader() = default;

void BagReader::readIndex() {
  char magic[sizeof(bag_format::kMagic) - 1] = {};
  if (file_->left() >= sizeof(magic)) file_->read(magic, sizeof(magic));
  if (std::memcmp(magic, bag_format::kMagic, sizeof(magic)) != 0)
    fail("it does not begin with '#ROSBAG V2.0' (older bags: 'rosbag fix')");
  std::uint64_t chunk = 0; // position of the last one, to which the index records after it belong
  bool has_header = false, index_found = false;
  std::uint64_t index = 0; // where its connections begin, which rosbag goes by
  while (file_->left() > 0) {
    const std::uint64_t position = file_->position();
    index_found = index_found || (has_header && position == index);
    const Fields fields(*file_);
    const std::uint8_t op = fields.op();
    if (has_header != (op != bag_format::kBagHeader)) fail("its bag header is missing or not the only one");
    if (op == bag_format::kConnection) {
      const Fields sender(*file_);
      connections_[fields.number<std::uint32_t>("conn")] = {fields.text("topic"), sender.text("type"),
                                                            sender.text("md5sum")};
      continue;
    }
    const std::uint32_t length = file_->length("a record");
    const std::uint64_t end = file_->position() + length;
    if (op == bag_format::kBagHeader) {
      has_header = true;
      if (!fields.text("encryptor").empty()) fail("it is encrypted, which is not supported");
      index = fields.number<std::uint64_t>("index_pos");
      if (index == 0) fail("it has no index, so its recording was cut short; try 'rosbag reindex'");
    } else if (op == bag_format::kChunk) {
      chunk = position;
    } else if (op == bag_format::kIndex) {
      if (chunk == 0) fail("an index belongs to no chunk");
      readEntries(chunk, fields.number<std::uint32_t>("conn"), fields.number<std::uint32_t>("count"), length);
    }
    if (file_->position() != end) file_->seek(end);
  }
  if (!has_header) fail("it has no bag header");
  if (!index_found && file_->position() != index)
    fail("its index is not where it says (cut short? try 'rosbag reindex')");
}

void BagReader::readEntries(std::uint64_t chunk, std::uint32_t connection, std::uint32_t count,
                            std::uint32_t bytes) {
  if (std::uint64_t(count) * bag_format::kIndexEntry != bytes)
    fail("a chunk's index is not as long as it says");
  for (std::uint32_t i = 0; i < count; ++i) {
    std::uint32_t entry[3]; // s, ns, offset
    file_->read(entry, sizeof(entry));
    entries_.push_back({entry[0] * std::uint64_t(1000000000) + entry[1], chunk, entry[2], connection});
  }
}

void BagReader::readChunk(std::uint64_t position) {
  if (chunk_position_ == position) return;
  chunk_position_ = 0;
  chunk_ = Bytes(); // two would need twice the memory
  file_->seek(position);
  const Fields fields(*file_);
  Bytes packed(file_->length("a chunk"));
  file_->read(packed.data(), packed.size());
  chunk_ =
      bag_format::unpack(std::move(packed), fields.text("compression"), fields.number<std::uint32_t>("size"));
  chunk_position_ = position;
}

BagMessage BagReader::messageOf(const Entry& entry) try {
  readChunk(entry.chunk);
  if (entry.offset >= chunk_.size()) fail("a chunk's index names a message that is none");
  for (MemorySource source(chunk_, entry.offset); source.left() > 0;) {
    const Fields fields(source);
    const std::uint32_t size = source.length("a record in a chunk");
    if (fields.op() == bag_format::kMessage && fields.number<std::uint32_t>("conn") == entry.connection) {
      return {connections_.at(entry.connection), reinterpret_cast<const std::uint8_t*>(source.here()), size,
              entry.time};
    }
    if (fields.op() != bag_format::kConnection) break; // which may precede its first message
    source.skip(size);
  }
  fail("a chunk's index names a message that is none");
} catch (const std::exception& error) { // of memory too
  throw BagError(path_ + ": cannot be read on: " + error.what());
}

std::vector<BagReader::Entry> BagReader::entriesOf(const std::set<std::string>& topics) const {
  std::vector<Entry> wanted;
  for (const Entry& entry : entries_) {
    const auto found = connections_.find(entry.connection);
    if (found != connections_.end() && topics.count(found->second.topic) > 0) wanted.push_back(entry);
  }
  return wanted;
}

void BagReader::forEach(const std::set<std::string>& topics,
                        const std::function<bool(const BagMessage&, double)>& visit) {
  std::vector<Entry> wanted = entriesOf(topics);
  const auto place = [](const Entry& e) { return std::make_tuple(e.time, e.chunk, e.offset); };
  std::sort(wanted.begin(), wanted.end(),
            [&](const Entry& a, const Entry& b) { return place(a) < place(b); });
  const auto total = static_cast<double>(wanted.size());
  double done = 0.0;
  for (const Entry& entry : wanted) {
    if (!visit(messageOf(entry), ++done / total)) return;
  }
}

} // namespace vi_ekf_slam
