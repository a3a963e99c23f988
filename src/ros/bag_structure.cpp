// Format: http://wiki.ros.org/Bags/Format/2.0
#include "vi_ekf_slam/ros/bag_structure.hpp"

#include <bzlib.h>
#include <roslz4/lz4s.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <vector>

namespace vi_ekf_slam {
namespace {

constexpr char kMagic[] = "#ROSBAG V2.0\n";
constexpr std::uint32_t kMaxHeader = 1 << 20; // bytes; the longest thing in one is a message's definition
constexpr std::uint32_t kMaxChunk = 64
                                    << 20; // bytes unpacked; rosbag writes 768 KiB and at least one message
constexpr std::uint32_t kIndexEntry = 12;  // bytes: time, offset
enum Op : std::uint8_t {
  kMessage = 2,
  kBagHeader = 3,
  kIndex = 4,
  kChunk = 5,
  kChunkInfo = 6,
  kConnection = 7
};

using Bytes = std::vector<char>;

/// The fields of a record's header.
class Fields {
 public:
  explicit Fields(const Bytes& header) {
    for (std::size_t at = 0; at < header.size();) {
      std::uint32_t length = 0;
      if (header.size() - at < sizeof(length)) throw std::runtime_error("a record's header is cut short");
      std::memcpy(&length, header.data() + at, sizeof(length));
      at += sizeof(length);
      if (length > header.size() - at) throw std::runtime_error("a field of a record's header is cut short");
      const std::string field(header.data() + at, length);
      const std::size_t equals = field.find('=');
      if (equals == std::string::npos) throw std::runtime_error("a field of a record's header has no name");
      values_[field.substr(0, equals)] = field.substr(equals + 1);
      at += length;
    }
  }

  template <typename T>
  T number(const char* name) const {
    const auto found = values_.find(name);
    if (found == values_.end() || found->second.size() != sizeof(T)) {
      throw std::runtime_error(std::string("a record lacks the field '") + name + "'");
    }
    T value;
    std::memcpy(&value, found->second.data(), sizeof(T));
    return value;
  }
  std::string text(const char* name) const {
    const auto found = values_.find(name);
    return found == values_.end() ? std::string() : found->second;
  }

 private:
  std::map<std::string, std::string> values_;
};

/// Bytes in memory or in a file, from a position on.
class Source {
 public:
  virtual ~Source() = default;
  virtual std::uint64_t left() const = 0;
  virtual void read(void* to, std::size_t count) = 0; ///< `count` at most left()
  virtual void skip(std::uint64_t count) = 0;

  std::uint32_t length(const char* of, std::uint32_t limit) {
    std::uint32_t value = 0;
    if (left() < sizeof(value)) throw std::runtime_error("it ends within a record (cut short?)");
    read(&value, sizeof(value));
    if (value > left()) throw std::runtime_error(std::string(of) + " goes beyond the end (cut short?)");
    if (value > limit) {
      throw std::runtime_error(std::string(of) + " has " + std::to_string(value) +
                               " bytes, allowed: at most " + std::to_string(limit));
    }
    return value;
  }
};

class MemorySource : public Source {
 public:
  explicit MemorySource(const Bytes& bytes) : bytes_(bytes) {}
  std::uint64_t left() const override { return bytes_.size() - at_; }
  std::size_t position() const { return at_; }
  void read(void* to, std::size_t count) override {
    if (count > 0) std::memcpy(to, bytes_.data() + at_, count);
    at_ += count;
  }
  void skip(std::uint64_t count) override { at_ += static_cast<std::size_t>(count); }

 private:
  const Bytes& bytes_;
  std::size_t at_ = 0;
};

class FileSource : public Source {
 public:
  explicit FileSource(const std::string& path) : file_(path, std::ios::binary) {
    file_.seekg(0, std::ios::end);
    size_ = file_ ? static_cast<std::uint64_t>(file_.tellg()) : 0;
    file_.seekg(0);
    if (!file_) throw std::runtime_error("cannot be read");
  }
  std::uint64_t left() const override { return size_ - at_; }
  std::uint64_t position() const { return at_; }
  void read(void* to, std::size_t count) override {
    if (!file_.read(static_cast<char*>(to), static_cast<std::streamsize>(count))) {
      throw std::runtime_error("cannot be read");
    }
    at_ += count;
  }
  void skip(std::uint64_t count) override {
    at_ += count;
    file_.seekg(static_cast<std::streamoff>(at_));
  }

 private:
  std::ifstream file_;
  std::uint64_t size_ = 0, at_ = 0;
};

Fields readHeader(Source& source) {
  Bytes header(source.length("a record's header", kMaxHeader));
  source.read(header.data(), header.size());
  return Fields(header);
}

Bytes unpack(const Bytes& packed, const std::string& compression, std::uint32_t size) {
  if (size > kMaxChunk) {
    throw std::runtime_error("a chunk unpacks to " + std::to_string(size) + " bytes, allowed: at most " +
                             std::to_string(kMaxChunk));
  }
  if (compression == "none") {
    if (packed.size() != size) throw std::runtime_error("a chunk is not as long as it says");
    return packed;
  }
  Bytes content(size);
  unsigned int got = size;
  bool good = false;
  char nothing = 0;
  char* to = content.empty() ? &nothing : content.data();
  if (compression == "bz2") {
    good = BZ2_bzBuffToBuffDecompress(to, &got, const_cast<char*>(packed.data()),
                                      static_cast<unsigned int>(packed.size()), 0, 0) == BZ_OK;
  } else if (compression == "lz4") {
    good = roslz4_buffToBuffDecompress(const_cast<char*>(packed.data()),
                                       static_cast<unsigned int>(packed.size()), to, &got) == ROSLZ4_OK;
  } else {
    throw std::runtime_error("a chunk is compressed with '" + compression + "', allowed: none, bz2, lz4");
  }
  if (!good || got != size) throw std::runtime_error("a chunk cannot be unpacked");
  return content;
}

/// The walk over a file, with what later records have to agree with.
class Walk {
 public:
  explicit Walk(const std::string& path) : file_(path) {}

  void run() {
    readMagic();
    while (file_.left() > 0) readRecord();
    if (!has_header_) throw std::runtime_error("it has no bag header");
    // rosbag goes by the positions: each must be where such a record begins.
    if (!index_found_) throw std::runtime_error("its index is not where it says");
    std::sort(indexed_chunks_.begin(), indexed_chunks_.end());
    if (indexed_chunks_ != chunks_ || announced_chunks_ != chunks_.size()) {
      throw std::runtime_error("its index names other chunks than there are");
    }
  }

 private:
  void readMagic() {
    char magic[sizeof(kMagic) - 1] = {};
    if (file_.left() >= sizeof(magic)) file_.read(magic, sizeof(magic));
    if (std::memcmp(magic, kMagic, sizeof(magic)) != 0) {
      throw std::runtime_error("it does not begin with '#ROSBAG V2.0' (older bags: 'rosbag fix')");
    }
  }

  void readRecord() {
    const std::uint64_t position = file_.position();
    const Fields fields = readHeader(file_);
    const std::uint8_t op = fields.number<std::uint8_t>("op");
    if (has_header_ != (op != kBagHeader))
      throw std::runtime_error("its bag header is missing or not the only one");
    index_found_ = index_found_ || (has_header_ && position == index_position_);
    if (op == kConnection) {
      readHeader(file_); // what its data is too; rosbag reads the fields without looking where they end
      return;
    }
    const std::uint32_t length = file_.length("a record", op == kChunk ? kMaxChunk : UINT32_MAX);
    if (op == kBagHeader) {
      readBagHeader(fields);
      file_.skip(length);
    } else if (op == kChunk) {
      chunks_.push_back(position);
      readChunk(fields, length);
    } else if (op == kIndex) {
      readIndex(fields, length);
    } else {
      if (op == kChunkInfo) readChunkInfo(fields, length);
      file_.skip(length);
    }
  }

  void readBagHeader(const Fields& fields) {
    has_header_ = true;
    index_position_ = fields.number<std::uint64_t>("index_pos");
    announced_chunks_ = fields.number<std::uint32_t>("chunk_count");
    fields.number<std::uint32_t>("conn_count");
    if (!fields.text("encryptor").empty())
      throw std::runtime_error("it is encrypted, which is not supported");
    if (index_position_ == 0) {
      throw std::runtime_error("it has no index, so its recording was cut short; try 'rosbag reindex'");
    }
  }

  void readChunk(const Fields& fields, std::uint32_t length) {
    Bytes packed(length);
    file_.read(packed.data(), packed.size());
    const Bytes content = unpack(packed, fields.text("compression"), fields.number<std::uint32_t>("size"));
    messages_.clear();
    for (MemorySource source(content); source.left() > 0;) {
      const auto offset = static_cast<std::uint32_t>(source.position());
      const std::uint8_t op = readHeader(source).number<std::uint8_t>("op");
      source.skip(source.length("a record in a chunk", UINT32_MAX));
      if (op == kMessage) messages_.push_back(offset);
    }
  }

  void readIndex(const Fields& fields, std::uint32_t length) {
    const auto count = fields.number<std::uint32_t>("count");
    if (std::uint64_t(count) * kIndexEntry != length)
      throw std::runtime_error("a chunk's index is not as long as it says");
    for (std::uint32_t i = 0; i < count; ++i) {
      std::uint32_t entry[3];
      file_.read(entry, sizeof(entry));
      if (!std::binary_search(messages_.begin(), messages_.end(), entry[2]))
        throw std::runtime_error("a chunk's index names a message that is none");
    }
  }

  void readChunkInfo(const Fields& fields, std::uint32_t length) {
    if (std::uint64_t(fields.number<std::uint32_t>("count")) * 8 != length) {
      throw std::runtime_error("its index is not as long as it says");
    }
    indexed_chunks_.push_back(fields.number<std::uint64_t>("chunk_pos"));
  }

  FileSource file_;
  bool has_header_ = false;
  std::uint64_t index_position_ = 0;
  std::size_t announced_chunks_ = 0;
  bool index_found_ = false;
  std::vector<std::uint64_t> chunks_,
      indexed_chunks_;                  ///< positions of the chunks, and those that the index names
  std::vector<std::uint32_t> messages_; ///< offsets in the newest chunk, ascending
};

} // namespace

void checkBagStructure(const std::string& path) {
  try {
    Walk(path).run();
  } catch (const std::runtime_error& error) {
    throw BagError(path + ": is not a bag that can be read: " + error.what());
  }
}

void openCheckedBag(rosbag::Bag& bag, const std::string& path) {
  if (!std::filesystem::exists(path)) throw BagError(path + ": no such file");
  if (!std::filesystem::is_regular_file(path)) throw BagError(path + ": is not a file");
  if (std::filesystem::file_size(path) == 0) throw BagError(path + ": is empty");
  checkBagStructure(path);
  try {
    bag.open(path, rosbag::bagmode::Read);
  } catch (const std::exception& e) { // a damaged file can make rosbag throw more than BagException
    throw BagError(path + ": is not a bag that can be read: " + e.what());
  }
}

} // namespace vi_ekf_slam
