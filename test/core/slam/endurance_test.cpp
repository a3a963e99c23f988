#include <unistd.h>

#include <algorithm>
#include <fstream>

#include "../../sanitized.hpp"
#include "../road.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

/// Resident memory of this process, bytes (Linux).
double residentBytes() {
  double whole = 0.0, resident = 0.0;
  std::ifstream("/proc/self/statm") >> whole >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE));
}

/// Resident memory in the fifth tenth of a drive and in its last one, bytes, the largest of each. (In a
/// million frames with four features the last estimates of landmarks that left for good, which are bounded as
/// well, are 100000 after a third.)
struct Memory {
  double early = 0.0, late = 0.0;
};

/// Drives `frames` and expects all covariances to be sound.
Memory driveCheaply(int frames, std::size_t features) {
  Road road(2, features, kTypical);
  InvariantConfig config = steadyTracks();
  config.map.max_landmarks = 1000;
  config.map.min_track_s = 0.2;
  InvariantEstimator estimator = withRig(config);
  int unsound = 0;
  std::size_t whole = 0, largest = 0, inactive = 0;
  Memory memory;
  for (int i = 0; i < frames; ++i) {
    const FrameReport report = road.feed(estimator);
    whole += report.frame_rejected ? 1 : 0;
    largest = std::max(largest, report.landmarks);
    inactive = std::max(inactive, report.inactive);
    if (i % 100 == 0) {
      const StateEstimate state = estimator.state();
      unsound += isPositiveDefinite(state.pose_covariance) ? 0 : 1;
      unsound += isPositiveDefinite(state.twist_covariance) ? 0 : 1;
      unsound += so3::isRotation(state.world_T_imu.rotation(), 1e-12) ? 0 : 1;
      if (i / (frames / 10) == 4) memory.early = std::max(memory.early, residentBytes());
      if (i / (frames / 10) == 9) memory.late = std::max(memory.late, residentBytes());
    }
  }
  EXPECT_EQ(unsound, 0);
  EXPECT_LE(whole, static_cast<std::size_t>(frames) / 100);
  EXPECT_LE(largest, features);
  EXPECT_LE(inactive, 1000u);
  return memory;
}

TEST(InvariantEstimator, KeepsItsCovarianceSoundOverALongDrive) {
  driveCheaply(kSanitized ? 2000 : 20000, 20);
}

// For the night (scripts/nightly.sh soak); for every day there is the short soak, of more features.
TEST(InvariantEstimator, DISABLED_KeepsItsCovarianceSoundOverAMillionFramesInConstantMemory) {
  const Memory memory = driveCheaply(1000000, 4);
  EXPECT_GT(memory.early, 0.0);
  EXPECT_LE(memory.late, 1.1 * memory.early);
}

} // namespace
} // namespace vi_ekf_slam
