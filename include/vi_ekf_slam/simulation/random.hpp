#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <random>

namespace vi_ekf_slam::simulation {

/// Who draws. Numbered by their order: no two can share their numbers by mistake. A new one goes to the end,
/// so that the drives of the others stay what they are.
enum class RandomStream : std::uint64_t {
  kMotion = 1,
  kScene,
  kTraffic,
  kPixelNoise,
  kTracks,
  kStaleFrames,
  kImu,
  kBiases,
  kTrackDrift,
  kStrengths,
  kTrackWalks,
  kBiasWalks,
  kStart,
  kRig,
  kAppearance,
  kImuScale,
  kCorners,
  kLast = kCorners
};

/// SplitMix64 (Steele, Lea and Flood 2014): one number from another, as if by chance.
std::uint64_t mix(std::uint64_t x);

/// Random numbers that depend on (seed, stream) alone. The distributions of `<random>` differ between standard
/// libraries, its engines do not; so the engine is theirs and the distributions are ours.
class Random {
 public:
  /// Streams of one seed are independent: drawing more from one leaves the others as they are.
  Random(std::uint64_t seed, RandomStream stream);

  /// In [0, 1).
  double uniform();
  /// In [low, high).
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  /// In [low, high], both included.
  int integer(int low, int high);
  /// Standard normal (Box and Muller 1958).
  double normal();
  Eigen::Vector3d normal3();
  /// Exponential of mean 1.
  double exponential();
  /// +1 or -1.
  double sign() { return uniform() < 0.5 ? -1.0 : 1.0; }

 private:
  std::mt19937_64 engine_;
  double spare_ = 0.0;
  bool has_spare_ = false;
};

} // namespace vi_ekf_slam::simulation
