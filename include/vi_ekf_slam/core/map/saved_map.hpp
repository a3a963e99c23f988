#pragma once

#include <Eigen/Core>
#include <stdexcept>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// A map that cannot be used or written. what() names the file, the field, the value and what is allowed.
class MapError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// More landmarks are not saved, nor read: their covariance takes (18 + 3 k)^2 numbers, 1.2 GB of memory.
constexpr std::size_t kMaxSavedLandmarks = 4000;
/// Rows of the joint covariance before those of the landmarks.
constexpr Eigen::Index kSavedBase = 18;

struct SavedLandmark {
  FeatureId id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero(); ///< m, map
  std::size_t observations = 0;                       ///< that corrected the estimate
};

/// All that an estimate knows at one time: from it a run goes on, or another one finds its place in the map.
struct SavedMap {
  Stamp stamp = 0;
  SE3 world_T_imu;
  Vector6d twist = Vector6d::Zero();    ///< (v in m/s, omega in rad/s), IMU frame
  Vector6d bias = Vector6d::Zero();     ///< of the measured twist, same order, units and frame
  std::vector<SavedLandmark> landmarks; ///< unique ids, the one that is longest out of view first
  /// (18 + 3 k) square, of the errors of position (m), rotation (rad; R = Exp(dtheta) R^), twist, bias and of
  /// each landmark (m), along the world axes.
  Eigen::MatrixXd covariance;
};

/// Throws MapError, in the name of `source`, unless all of it is finite and within what a drive can reach,
/// and the covariance symmetric and positive semidefinite.
void validate(const SavedMap& map, const std::string& source);

/// Throws the MapError of `field`, which has this value.
[[noreturn]] void refuse(const std::string& source, const std::string& field, const std::string& value,
                         const std::string& allowed);

} // namespace vi_ekf_slam
