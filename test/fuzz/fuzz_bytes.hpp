#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>

namespace vi_ekf_slam::fuzz {

/// Turns a fuzzer's bytes into values, one after the other; after the last byte everything is zero. Each
/// choice takes few bytes, so that a mutation of one byte changes one choice.
class FuzzBytes {
 public:
  FuzzBytes(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}

  bool empty() const { return size_ == 0; }

  std::uint8_t byte() { return raw<std::uint8_t>(); }
  std::uint32_t word() { return raw<std::uint32_t>(); }
  /// From 0 to `count` - 1.
  std::size_t below(std::size_t count) { return byte() % count; }
  /// One byte: within +-`scale`, in steps of scale / 128.
  double small(double scale) { return scale * static_cast<double>(static_cast<std::int8_t>(byte())) / 128.0; }

  /// Mostly `usual`; one time in sixteen a number that breaks things, or any 64 bits read as a double.
  double number(double usual) {
    static constexpr double kInf = std::numeric_limits<double>::infinity();
    static constexpr std::array<double, 13> kSpecial = {std::numeric_limits<double>::quiet_NaN(),
                                                        kInf,
                                                        -kInf,
                                                        1e308,
                                                        -1e308,
                                                        1e154,
                                                        5e-324,
                                                        -0.0,
                                                        0.0,
                                                        1.0,
                                                        -1.0,
                                                        1e9,
                                                        1e-9};
    const std::uint8_t choice = byte();
    if (choice < 240) return usual;
    if (choice == 255) return raw<double>();
    return kSpecial[choice % kSpecial.size()];
  }

  /// At most `longest` characters.
  std::string text(std::size_t longest) {
    std::string result;
    for (std::size_t left = below(longest + 1); left > 0 && !empty(); --left) {
      result += static_cast<char>(byte());
    }
    return result;
  }

 private:
  template <typename T>
  T raw() {
    T value{};
    const std::size_t count = size_ < sizeof(T) ? size_ : sizeof(T);
    if (count > 0) std::memcpy(&value, data_, count);
    data_ += count;
    size_ -= count;
    return value;
  }

  const std::uint8_t* data_;
  std::size_t size_;
};

} // namespace vi_ekf_slam::fuzz
