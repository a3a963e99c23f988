#include "vi_ekf_slam/simulation/random.hpp"

#include <algorithm>
#include <cmath>

namespace vi_ekf_slam::simulation {

std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9;
  x = (x ^ (x >> 27)) * 0x94d049bb133111eb;
  return x ^ (x >> 31);
}

Random::Random(std::uint64_t seed, RandomStream stream)
    : engine_(mix(mix(seed) + static_cast<std::uint64_t>(stream))) {}

double Random::uniform() { return static_cast<double>(engine_() >> 11) * 0x1.0p-53; }

int Random::integer(int low, int high) {
  const double span = static_cast<double>(high) - low + 1.0;
  return std::min(high, low + static_cast<int>(span * uniform()));
}

double Random::normal() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
  const double angle = 6.283185307179586 * uniform();
  spare_ = radius * std::sin(angle);
  has_spare_ = true;
  return radius * std::cos(angle);
}

Eigen::Vector3d Random::normal3() {
  const double x = normal(), y = normal(), z = normal();
  return {x, y, z};
}

double Random::exponential() { return -std::log(1.0 - uniform()); }

} // namespace vi_ekf_slam::simulation
