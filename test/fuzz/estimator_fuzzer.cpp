/// Measurements of any value in any order into SlamSystem, with each of the estimators.
#include <iterator>

#include "fuzz_bytes.hpp"
#include "system_checks.hpp"

namespace vi_ekf_slam::fuzz {
namespace {

constexpr std::size_t kMostSteps = 150;
constexpr std::size_t kMostMapped = 30;  ///< landmarks that have left, as configured here
constexpr std::size_t kMostTracked = 40; ///< features of the largest frame

Config chooseConfig(FuzzBytes& bytes) {
  Config config;
  config.invariant.map.max_landmarks = kMostMapped;
  config.paper.landmark_fraction = 1.0;
  const std::size_t kind = bytes.below(8);
  if (kind >= 5) config.estimator = EstimatorType::kPaper;
  if (kind == 4) config.invariant.rig = {Eigen::Vector3d::Constant(0.02), Eigen::Vector3d::Constant(0.02), 0.01, 0.03, 0.005, {}};
  if (kind == 3) config.invariant.update.consensus = false;
  if (kind == 5) config.paper.mode = PaperMode::kDeadReckoning;
  if (kind == 6) config.paper.mode = PaperMode::kMapping;
  config.buffer.max_size = 1 + bytes.below(64);
  return config;
}

/// The next stamp: mostly a step ahead, sometimes none, back, a gap, or anywhere.
Stamp chooseStamp(FuzzBytes& bytes, Stamp now) {
  static constexpr double kSteps[] = {0.01, 0.1, 0.0, 1.0, 1e-9, -0.01, -0.1, -0.9, -1.1, 5.0, 0.5, 60.0};
  const std::uint8_t choice = bytes.byte();
  if (choice < 192) return now + fromSeconds(choice < 128 ? 0.01 : 0.1);
  if (choice < 255) return now + fromSeconds(kSteps[choice % std::size(kSteps)]);
  return static_cast<Stamp>(bytes.word()) * 1000000000 + bytes.byte();
}

std::optional<Eigen::Matrix3d> chooseCovariance(FuzzBytes& bytes) {
  const std::size_t kind = bytes.below(8);
  if (kind < 5) return std::nullopt;
  Eigen::Matrix3d C = bytes.number(0.01) * Eigen::Matrix3d::Identity();
  if (kind == 6) C(1, 0) = C(0, 1) = bytes.number(0.001);
  if (kind == 7) C(2, 1) = bytes.number(0.0);
  return C;
}

Eigen::Vector3d chooseVector(FuzzBytes& bytes, double scale) {
  Eigen::Vector3d v;
  for (double& x : v) x = bytes.number(bytes.small(scale));
  return v;
}

/// A camera like KITTI's, or with the extreme numbers that RigAssembler lets pass.
StereoRig chooseRig(FuzzBytes& bytes) {
  static constexpr double kFocalLengths[] = {700.0, 1.0, 1e6, 100.0};
  static constexpr double kBaselines[] = {0.5, 1e-6, 1e3, 0.05};
  StereoRig rig;
  rig.camera = {kFocalLengths[bytes.below(4)], kFocalLengths[bytes.below(4)], 600.0, 180.0,
                kBaselines[bytes.below(4)]};
  Eigen::Matrix3d R;
  R << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  rig.cam_T_imu = SE3(R, {0.1, 0.2, -0.3});
  return rig;
}

StereoFrame chooseFrame(FuzzBytes& bytes, Stamp stamp) {
  StereoFrame frame;
  frame.stamp = stamp;
  const bool many = bytes.below(32) == 31;
  const std::size_t count = many ? kMostTracked : bytes.below(17);
  const std::size_t first = bytes.below(32);
  for (std::size_t i = 0; i < count; ++i) {
    // Ids come back, also within a frame; places depend on the id, so that tracks are tracks.
    const std::size_t id = first + (bytes.below(16) == 15 ? 0 : i);
    const double u = 100.0 + 60.0 * static_cast<double>(id % 18) + bytes.small(2.0);
    const double v = 40.0 + 20.0 * static_cast<double>(id % 14);
    const double disparity = 3.0 + static_cast<double>(id % 7) * 6.0 + bytes.small(1.0);
    frame.features.push_back(
        {id == 0 ? FeatureId(-1) : id, StereoPixels(bytes.number(u), bytes.number(v), u - disparity, v)});
  }
  return frame;
}

void run(FuzzBytes bytes) {
  SlamSystem system(chooseConfig(bytes));
  watch(system);
  Stamp now = fromSeconds(1e9);
  for (std::size_t step = 0; step < kMostSteps && !bytes.empty(); ++step) {
    const std::size_t action = bytes.below(32);
    if (action == 31) {
      system.setRig(chooseRig(bytes));
    } else if (action == 30) {
      system.reset("fuzzer");
    } else if (action == 29) {
      system.flush();
    } else {
      now = chooseStamp(bytes, now);
      if (action < 10) {
        system.add(ImuSample{now, chooseVector(bytes, 0.5), chooseCovariance(bytes)});
      } else if (action < 18) {
        system.add(VelocitySample{now, chooseVector(bytes, 20.0), chooseCovariance(bytes)});
      } else {
        system.add(chooseFrame(bytes, now));
      }
    }
    if (step == 0) system.setRig(chooseRig(bytes));
  }
  system.flush();
  // The paper's filter keeps every landmark; there are as many as ids.
  checkLandmarks(system.estimator(), kMostMapped + kMostTracked + 64);
}

} // namespace
} // namespace vi_ekf_slam::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  vi_ekf_slam::fuzz::run({data, size});
  return 0;
}
