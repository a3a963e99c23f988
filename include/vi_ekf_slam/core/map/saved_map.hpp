#pragma once

#include <Eigen/Core>
#include <stdexcept>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/map/descriptor_set.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// A map that cannot be used or written. what() names the file, the field, the value and what is allowed.
class MapError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// More landmarks are not saved, nor read: their covariance takes (3 k)^2 numbers, 1.2 GB of memory.
constexpr std::size_t kMaxSavedLandmarks = 4000;
/// Nor more variables, nor longer ones (rows), nor longer names (characters).
constexpr std::size_t kMaxSavedVariables = 16, kMaxSavedRows = 32, kMaxSavedName = 32;
/// m, of a pose or landmark from the map's origin.
constexpr double kMaxSavedDistance = 1e6;

/// What the filter has beside pose and landmarks: a motion model's variables, biases, calibration.
struct SavedVariable {
  std::string name;     ///< unique, of a to z, 0 to 9 and _: what it is, its units and its axes
  Eigen::VectorXd mean; ///< as many numbers as its error has rows
};

struct SavedLandmark {
  FeatureId id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero(); ///< m, map
  std::size_t observations = 0;                       ///< that corrected the estimate
  DescriptorSet descriptors = {};                     ///< what it looks like, where that is known
};

/// All that an estimate knows at one time: from it a run goes on, or another one finds its place in the map.
struct SavedMap {
  Stamp stamp = 0;
  SE3 world_T_imu;
  std::vector<SavedVariable> variables; ///< in the order of their errors
  std::vector<SavedLandmark> landmarks; ///< unique ids, the one that is longest out of view first
  /// (base + 3 k) square, of the errors of position (m), rotation (rad; R = Exp(dtheta) R^), of each variable
  /// (as it is named) and of each landmark (m), along the world axes.
  Eigen::MatrixXd covariance;

  /// Rows of the covariance before those of the landmarks.
  Eigen::Index base() const;
  Eigen::Index rowOf(std::size_t landmark) const { return base() + 3 * static_cast<Eigen::Index>(landmark); }
};

/// What became of a map that was given to an estimator.
enum class MapUse {
  kNone,        ///< none was given
  kWaiting,     ///< the vehicle has not found its place in it yet: estimates are in a frame of their own
  kRelocalised, ///< estimates are in its frame
  kResumed,     ///< they are, from the first one on
};

/// Throws MapError, in the name of `source`, unless all of it is finite and within what a drive can reach,
/// and the covariance symmetric and positive semidefinite.
void validate(const SavedMap& map, const std::string& source);
/// The same for the variables alone: their number, names, sizes and values.
void validate(const std::vector<SavedVariable>& variables, const std::string& source);

/// Throws the MapError of `field`, which has this value.
[[noreturn]] void refuse(const std::string& source, const std::string& field, const std::string& value,
                         const std::string& allowed);

} // namespace vi_ekf_slam
