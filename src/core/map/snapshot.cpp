#include "vi_ekf_slam/core/map/snapshot.hpp"

#include <utility>

#include "vi_ekf_slam/core/map/relocaliser.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kKeptObservations = 3; // of a landmark in view, to be worth keeping

} // namespace

SavedMap snapshotOf(Filter filter, LandmarkMap landmarks, const MotionModel& motion, Stamp stamp) {
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
  if (filter.inactive().size() > kMaxSavedLandmarks)
    filter.marginaliseOldest(filter.inactive().size() - kMaxSavedLandmarks);
  filter.settleInactive();
  const InactiveStore& inactive = filter.inactive();
  const Eigen::Index rows = inactive.isEmpty() ? 0 : inactive.rows();
  SavedMap map;
  map.stamp = stamp;
  map.world_T_imu = filter.pose();
  map.twist = motion.twist(filter);
  map.bias = motion.bias(filter);
  map.covariance.resize(kSavedBase + rows, kSavedBase + rows);
  map.covariance.topLeftCorner<kSavedBase, kSavedBase>() =
      filter.covariance().topLeftCorner<kSavedBase, kSavedBase>();
  if (rows == 0) return map;
  map.covariance.topRightCorner(kSavedBase, rows) = inactive.cross().topRows<kSavedBase>();
  map.covariance.bottomLeftCorner(rows, kSavedBase) = inactive.cross().topRows<kSavedBase>().transpose();
  map.covariance.bottomRightCorner(rows, rows) = inactive.covariance();
  for (const InactiveVariable& variable : inactive.variables()) {
    const Landmark& landmark = landmarks.inactive(variable.handle);
    map.landmarks.push_back({landmark.id, variable.mean, landmark.observations});
  }
  return map;
}

void restore(const SavedMap& map, Filter& filter, LandmarkMap& landmarks, const MotionModel& motion) {
  LoadedMap loaded = loadedFrom(map);
  const Eigen::Index rows = loaded.covariance.rows() - kSavedBase, core = filter.coreRows();
  filter.begin(map.world_T_imu);
  motion.set(filter, map.twist, map.bias);
  Eigen::MatrixXd P = filter.covariance().topLeftCorner(core, core);
  P.topRows(kSavedBase).setZero();
  P.leftCols(kSavedBase).setZero();
  P.topLeftCorner<kSavedBase, kSavedBase>() = loaded.covariance.topLeftCorner<kSavedBase, kSavedBase>();
  filter.setCoreCovariance(P);
  Eigen::MatrixXd cross = Eigen::MatrixXd::Zero(core, rows);
  cross.topRows<kSavedBase>() = loaded.covariance.topRightCorner(kSavedBase, rows);
  if (rows > 0)
    landmarks.adopt(filter, loaded.landmarks, loaded.positions,
                    loaded.covariance.bottomRightCorner(rows, rows), std::move(cross));
}

} // namespace vi_ekf_slam
