/// Any bytes as a saved map: refused with a MapError, or used. What begins like a bag is one; other bytes are
/// the numbers of a map, which reach further.
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "fuzz_bytes.hpp"
#include "system_checks.hpp"
#include "vi_ekf_slam/ros/map_file.hpp"

namespace vi_ekf_slam::fuzz {
namespace {

constexpr std::size_t kSeen = 20;   // features of a frame
constexpr std::size_t kMapped = 12; // landmarks of a map at most
constexpr int kFrames = 14;
const Stamp kSaved = fromSeconds(1e9);

StereoRig rig() {
  StereoRig rig;
  rig.camera = {700.0, 700.0, 600.0, 180.0, 0.5};
  Eigen::Matrix3d R;
  R << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  rig.cam_T_imu = SE3(R, {0.1, 0.2, -0.3});
  return rig;
}

/// Where the feature of this id is seen by a camera that stands still, and what is there, in the IMU's frame.
StereoPixels pixelsOf(FeatureId id) {
  const double u = 100.0 + 55.0 * static_cast<double>(id), v = 40.0 + 40.0 * static_cast<double>(id % 7);
  return {u, v, u - 10.0 - 3.0 * static_cast<double>(id % 5), v};
}

Eigen::Vector3d pointOf(FeatureId id) {
  return rig().cam_T_imu.inverse() * rig().camera.triangulate(pixelsOf(id)).value();
}

SavedMap chooseMap(FuzzBytes& bytes) {
  SavedMap map;
  map.stamp = kSaved + (bytes.below(16) == 15 ? static_cast<Stamp>(bytes.word()) * 1000000000 - kSaved : 0);
  Vector6d pose, scale;
  scale << 1000.0, 1000.0, 10.0, 1.0, 1.0, 3.0;
  for (Eigen::Index i = 0; i < 6; ++i) pose[i] = bytes.small(scale[i]);
  const SE3 there_T_here = SE3::Exp(pose);
  map.variables = {{"twist", Vector6d::Zero()}, {"twist_bias", Vector6d::Zero()}, {"slip", Vector6d::Zero()}};
  for (SavedVariable& variable : map.variables) {
    for (double& x : variable.mean) x = bytes.number(0.0);
    if (bytes.below(32) == 31) variable.name = bytes.text(40);
    if (bytes.below(32) == 31) variable.mean.setZero(bytes.below(40));
  }
  map.variables.resize(map.variables.size() - bytes.below(32) / 29);
  map.world_T_imu = {there_T_here.rotation(),
                     there_T_here.translation() + Eigen::Vector3d(bytes.number(0.0), 0.0, 0.0)};
  const std::size_t count = kMapped - bytes.below(kMapped + 1);
  for (FeatureId id = 0; id < count; ++id) {
    Eigen::Vector3d position = there_T_here * pointOf(id);
    for (double& x : position) x = bytes.number(x + bytes.small(0.5));
    map.landmarks.push_back({bytes.below(32) == 31 ? FeatureId(-1) : id, position, bytes.byte()});
  }
  // Of independent errors, and some that are common to all.
  const Eigen::Index rows = map.rowOf(count);
  Eigen::MatrixXd common(rows, 6);
  for (Eigen::Index i = 0; i < common.size(); ++i) common(i) = bytes.small(1.0);
  map.covariance = common * common.transpose();
  for (Eigen::Index i = 0; i < rows; ++i)
    map.covariance(i, i) += bytes.number(0.01 * static_cast<double>(bytes.below(100)));
  for (std::size_t edits = bytes.below(4); edits > 0; --edits) {
    const Eigen::Index i = bytes.byte() % rows, j = bytes.byte() % rows;
    map.covariance(i, j) = map.covariance(j, i) = bytes.number(bytes.small(1.0));
  }
  return map;
}

void checkSavedAgain(const Estimator& estimator) {
  const auto snapshot = estimator.savedMap();
  if (!snapshot) return;
  try {
    validate(snapshot(), "saved again");
  } catch (const MapError& error) { // what was on the edge may have left it
    require(*error.what() != '\0', "a refusal says why");
  }
}

/// Stands before the features for some frames, with the map.
void use(const std::shared_ptr<const SavedMap>& map, bool resume, double gap) {
  SlamSystem system({});
  watch(system);
  system.setRig(rig());
  bool resumable = resume;
  try {
    if (resume) system.resumeFrom(map, "fuzzer");
  } catch (const MapError& error) { // of another motion model
    require(*error.what() != '\0', "a refusal says why");
    resumable = false;
  }
  if (!resumable) system.loadMap(map, "fuzzer");
  for (int i = 0; i < kFrames; ++i) {
    const Stamp now = map->stamp + fromSeconds(gap + 0.1 * i);
    system.add(ImuSample{now, Eigen::Vector3d::Zero(), {}});
    system.add(VelocitySample{now, Eigen::Vector3d::Zero(), {}});
    StereoFrame frame{now, {}};
    for (FeatureId id = 0; id < kSeen; ++id) frame.features.push_back({id, pixelsOf(id)});
    system.add(frame);
  }
  system.flush();
  checkLandmarks(system.estimator(), map->landmarks.size() + kSeen);
  checkSavedAgain(system.estimator());
}

void check(FuzzBytes bytes, const std::shared_ptr<const SavedMap>& map) {
  const double gap = 8.0 * static_cast<double>(bytes.below(4)); // s, up to some that are bridged
  use(map, true, gap);
  use(map, false, gap);
}

template <typename Make>
std::shared_ptr<const SavedMap> acceptedBy(const Make& make) {
  try {
    return std::make_shared<const SavedMap>(make());
  } catch (const MapError& error) {
    require(*error.what() != '\0', "a refusal says why");
    return nullptr;
  }
}

} // namespace
} // namespace vi_ekf_slam::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace vi_ekf_slam;
  if (size > 0 && *data == '#') {
    const int file = memfd_create("map", 0);
    if (file >= 0 && write(file, data, size) == static_cast<ssize_t>(size)) {
      const std::string path = "/proc/self/fd/" + std::to_string(file);
      if (const auto map = fuzz::acceptedBy([&] { return readMapFile(path); })) fuzz::check({data, 0}, map);
    }
    close(file);
    return 0;
  }
  fuzz::FuzzBytes bytes(data, size);
  const auto map = fuzz::acceptedBy([&] {
    SavedMap chosen = fuzz::chooseMap(bytes);
    validate(chosen, "fuzzer");
    return chosen;
  });
  if (map) fuzz::check(bytes, map);
  return 0;
}
