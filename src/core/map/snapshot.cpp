#include "vi_ekf_slam/core/map/snapshot.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/filter/symmetric.hpp"
#include "vi_ekf_slam/core/observation/rig_variables.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kKeptObservations = 3; // of a landmark in view, to be worth keeping
// m, standard deviation: one known to no better tells nothing about where a drive is. A correction of the
// inverse depth can send a far point farther yet by a factor of five, its variance by 5^4, and rounding
// beside such numbers would be the other landmarks' errors.
constexpr double kVaguest = 1e3;
constexpr double kSameRig = 1e-6;    // 1 and m: what a launch file's digits leave of one
constexpr double kRounding = 1e-12;  // of the largest variance
constexpr double kNewVariance = 1.0; // m^2, of errors that a drive adds to those of its map

/// The filter's variable of this name and size; without `corrections` not where it is one of the rig's.
std::optional<Handle> find(const SavedVariable& variable, const Filter& filter, bool corrections) {
  if (!corrections && RigVariables::isCorrection(variable.name)) return std::nullopt;
  const auto handle = filter.variables().find(variable.name);
  return handle && filter.variables().sizeOf(*handle) == variable.mean.size() ? handle : std::nullopt;
}

/// (m x n) 1 where a row of the map's covariance, of m before the landmarks, is one of the filter's n.
Eigen::MatrixXd sameRows(const SavedMap& map, const Filter& filter, bool corrections = true) {
  Eigen::MatrixXd same = Eigen::MatrixXd::Zero(map.base(), filter.rows());
  same.topLeftCorner<6, 6>().setIdentity();
  Eigen::Index row = 6;
  for (const SavedVariable& variable : map.variables) {
    const Eigen::Index size = variable.mean.size();
    if (const auto handle = find(variable, filter, corrections))
      same.block(row, filter.rowOf(*handle), size, size).setIdentity();
    row += size;
  }
  return same;
}

bool hasCorrections(const SavedMap& map) {
  return std::any_of(map.variables.begin(), map.variables.end(),
                     [](const SavedVariable& v) { return RigVariables::isCorrection(v.name); });
}

} // namespace

Eigen::MatrixXd loadedCovariance(const SavedMap& map, const Matrix6d& pose) {
  double farthest2 = map.world_T_imu.translation().squaredNorm();
  for (const SavedLandmark& l : map.landmarks) farthest2 = std::max(farthest2, l.position.squaredNorm());
  Eigen::MatrixXd covariance = map.covariance;
  auto variances = covariance.diagonal();
  // Errors about the origin: what turns there shifts what is far away.
  const double largest = std::max({kNewVariance, variances.maxCoeff(), pose.diagonal().maxCoeff()}) +
                         farthest2 * pose.diagonal().tail<3>().maxCoeff();
  variances.head<3>().array() += kRounding * largest;
  variances.tail(variances.size() - map.base()).array() += kRounding * largest;
  return covariance;
}

SavedMap snapshotOf(Filter filter, LandmarkMap landmarks, Stamp stamp,
                    const std::optional<StereoRig>& given) {
  filter.settle();
  // Landmarks in view are saved as if they left now.
  for (std::size_t i = landmarks.active().size(); i-- > 0;) {
    const Landmark& l = landmarks.active()[i];
    // Of one that is seen again but not yet fused, the map's estimate is the one that stays.
    if (l.observations >= kKeptObservations && !landmarks.isInactive(l.id))
      landmarks.deactivate(filter, i);
    else
      landmarks.discard(filter, i);
  }
  // Clones of the pose are among those that go.
  for (std::size_t held = landmarks.inactiveCount(); held > kMaxSavedLandmarks;) {
    const std::vector<Handle> gone = filter.marginaliseOldest(held - kMaxSavedLandmarks);
    held -= static_cast<std::size_t>(
        std::count_if(gone.begin(), gone.end(), [&](Handle handle) { return landmarks.isLandmark(handle); }));
  }
  filter.settleInactive();
  SavedMap map;
  map.stamp = stamp;
  map.world_T_imu = filter.pose();
  for (const auto& [name, handle] : filter.variables().named())
    map.variables.push_back({name, filter.variables().mean(handle)});
  if (given && hasCorrections(map))
    map.variables.push_back({RigVariables::kGivenRig, RigVariables::numbersOf(*given)});
  const InactiveStore& inactive = filter.inactive();
  std::vector<Eigen::Index> rows; // of those that are saved, in the store
  for (std::size_t i = 0; i < inactive.size(); ++i) {
    const InactiveVariable& variable = inactive.variables()[i];
    const Eigen::Index row = inactive.rowOf(i);
    if (!landmarks.isLandmark(variable.handle)) continue;
    if (variable.mean.cwiseAbs().maxCoeff() > kMaxSavedDistance ||
        inactive.covariance().block(row, row, 3, 3).diagonal().maxCoeff() > kVaguest * kVaguest)
      continue;
    const Landmark& landmark = landmarks.inactive(variable.handle);
    map.landmarks.push_back({landmark.id, variable.mean, landmark.observations, landmark.descriptors});
    rows.push_back(row);
  }
  const Eigen::MatrixXd same = sameRows(map, filter);
  const Eigen::Index base = map.base(), end = map.rowOf(rows.size());
  Eigen::MatrixXd& P = map.covariance;
  P.resize(end, end);
  P.topLeftCorner(base, base) = same * filter.covariance() * same.transpose();
  Eigen::Index column = base;
  for (const Eigen::Index from : rows) {
    P.block(column, 0, 3, base) = (same * inactive.cross().middleCols<3>(from)).transpose();
    const Eigen::MatrixXd own = inactive.covariance().middleRows(from, 3);
    Eigen::Index before = base;
    for (const Eigen::Index other : rows) {
      if (other <= from) P.block<3, 3>(column, before) = own.middleCols<3>(other);
      before += 3;
    }
    column += 3;
  }
  mirrorLower(P);
  return map;
}

bool correctsRig(const SavedMap& map, const std::optional<StereoRig>& given) {
  if (!hasCorrections(map)) return true;
  const auto of = std::find_if(map.variables.begin(), map.variables.end(),
                               [](const SavedVariable& v) { return v.name == RigVariables::kGivenRig; });
  if (!given || of == map.variables.end()) return false;
  const auto now = RigVariables::numbersOf(*given);
  return of->mean.size() == now.size() && (of->mean - now).cwiseAbs().maxCoeff() < kSameRig;
}

void restore(const SavedMap& map, Filter& filter, LandmarkMap& landmarks,
             const std::optional<StereoRig>& given) {
  const Eigen::MatrixXd P = loadedCovariance(map, map.covariance.topLeftCorner<6, 6>());
  const Eigen::Index base = map.base(), rows = P.rows() - base;
  const bool corrections = correctsRig(map, given);
  const Eigen::MatrixXd known = sameRows(map, filter, corrections).transpose();
  const Eigen::VectorXd unknown = 1.0 - known.rowwise().sum().array();
  filter.begin(map.world_T_imu);
  for (const SavedVariable& variable : map.variables) {
    if (const auto handle = find(variable, filter, corrections)) filter.setMean(*handle, variable.mean);
  }
  filter.setCoreCovariance(known * P.topLeftCorner(base, base) * known.transpose() +
                           unknown.asDiagonal() * filter.covariance() * unknown.asDiagonal());
  if (rows > 0)
    landmarks.adopt(filter, map, P.bottomRightCorner(rows, rows), known * P.topRightCorner(base, rows));
}

void requireMotion(const SavedMap& map, const Filter& filter, const MotionModel& motion,
                   const std::string& source) {
  const Eigen::VectorXd known = sameRows(map, filter).colwise().sum();
  for (const std::string& name : motion.variables()) {
    const Handle handle = filter.variables().find(name).value();
    const Eigen::Index size = filter.variables().sizeOf(handle);
    if (known.segment(filter.rowOf(handle), size).isOnes()) continue;
    refuse(source, "variable " + name, "missing or of another size",
           std::to_string(size) + " numbers, to resume from; relocalising in the map needs none");
  }
}

} // namespace vi_ekf_slam
