#include "vi_ekf_slam/simulation/appearance.hpp"

#include <cmath>

namespace vi_ekf_slam::simulation {
namespace {

constexpr std::uint64_t kKinds = 20; // that points look like which look alike
constexpr int kNoiseBits = 16;       // that are drawn anew in each observation: half of them change
constexpr double kPerDistance = 0.8; // k
constexpr double kMiddleLog = 2.7;   // of a distance of 15 m: about it distances count most
constexpr double kWholeRange = 18446744073709551616.0; // 2^64

} // namespace

Appearance::Appearance(const DriveOptions& options)
    : seed_(mix(options.seed)),
      alike_share_(options.alike_share),
      random_(options.seed, RandomStream::kAppearance) {
  if (!options.descriptors) return;
  for (Eigen::Index j = 0; j < responses_.size(); ++j) responses_(j) = random_.normal();
}

Descriptor Appearance::describe(std::uint64_t look, const Eigen::Vector3d& way) {
  const std::uint64_t chance = mix(seed_ ^ mix(look));
  const bool is_alike = static_cast<double>(chance) < alike_share_ * kWholeRange;
  const std::uint64_t pattern = is_alike ? mix(seed_ + mix(chance) % kKinds) : mix(chance);
  const double distance = way.norm();
  Eigen::Matrix<double, 5, 1> view;
  view << way / distance, kPerDistance * (std::log(distance) - kMiddleLog), 1.0;
  const Eigen::Matrix<double, 256, 1> response = responses_ * view;
  Descriptor descriptor{};
  for (std::size_t word = 0; word < 4; ++word) {
    const std::uint64_t bits = mix(pattern + word);
    for (std::size_t i = 0; i < 64; ++i) {
      const bool is_turned = response[static_cast<Eigen::Index>(64 * word + i)] > 0.0;
      if (((bits >> i & 1) != 0) != is_turned)
        descriptor[8 * word + i / 8] |= static_cast<std::uint8_t>(1 << i % 8);
    }
  }
  for (int i = 0; i < kNoiseBits; ++i) {
    const int bit = random_.integer(0, 255);
    if (random_.uniform() < 0.5)
      descriptor[static_cast<std::size_t>(bit / 8)] ^= static_cast<std::uint8_t>(1 << bit % 8);
  }
  return descriptor;
}

} // namespace vi_ekf_slam::simulation
