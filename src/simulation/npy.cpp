#include "vi_ekf_slam/simulation/npy.hpp"

#include <fstream>
#include <functional>
#include <numeric>
#include <stdexcept>
#include <type_traits>

namespace vi_ekf_slam::simulation {
namespace {

/// https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html: magic, version, length of the
/// header in two bytes, a Python dictionary padded so that the data start at a multiple of 64.
std::string header(const std::string& type, const std::vector<std::size_t>& shape) {
  std::string dictionary = "{'descr': '" + type + "', 'fortran_order': False, 'shape': (";
  for (const std::size_t n : shape) dictionary += std::to_string(n) + ",";
  dictionary += "), }";
  constexpr std::size_t kPrefix = 10;
  while ((kPrefix + dictionary.size() + 1) % 64 != 0) dictionary += ' ';
  dictionary += '\n';
  std::string head("\x93NUMPY\x01\x00", 8);
  head += static_cast<char>(dictionary.size() & 0xff);
  head += static_cast<char>(dictionary.size() >> 8);
  return head + dictionary;
}

} // namespace

/// Values in the machine's byte order, which is little-endian wherever ROS 1 runs.
template <class T>
void writeNpy(const std::string& path, const std::vector<T>& values, const std::vector<std::size_t>& shape) {
  const std::size_t size =
      std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<std::size_t>());
  if (size != values.size()) throw std::runtime_error(path + ": the shape does not fit the values");
  const std::string head = header(std::is_floating_point_v<T> ? "<f8" : "<i8", shape);
  std::ofstream out(path, std::ios::binary);
  out.write(head.data(), static_cast<std::streamsize>(head.size()));
  out.write(reinterpret_cast<const char*>(values.data()),
            static_cast<std::streamsize>(sizeof(T) * values.size()));
  out.close();
  if (!out) throw std::runtime_error(path + ": cannot be written");
}

template void writeNpy(const std::string&, const std::vector<double>&, const std::vector<std::size_t>&);
template void writeNpy(const std::string&, const std::vector<std::int64_t>&, const std::vector<std::size_t>&);

} // namespace vi_ekf_slam::simulation
