#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// How places are recognised where ids do not return.
enum class PlaceRecognition : std::uint8_t {
  kNone,
  kDescriptors,   ///< by what landmarks look like, where features come with descriptors
  kConstellation, ///< by their constellation too
};

/// A landmark as the recogniser sees it: a point (world, m) with a name.
struct PlacePoint {
  FeatureId id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
};

/// A place found again.
struct Recognition {
  SE3 before_T_now; ///< moves what is seen now onto what was seen before, world axes
  std::vector<std::pair<FeatureId, FeatureId>> matches; ///< (now, before)
};

/// Finds points seen now among points seen before by their constellation alone: no appearance, no ids.
/// Matches are proposed where they are possible under the uncertainty of the present pose and agree with each
/// other in pairs (the distance of two points does not depend on where one is); rigid transforms through
/// three of them are verified on all points. What is found must be far beyond what chance gives, must not
/// have a rival, and must be spread out: a false loop is worse than none.
///
/// `about` is the vehicle's position (world, m), `covariance` the 6x6 of (position, rotation) along the world
/// axes of its error against the points seen before. Deterministic. Nothing where nothing is recognised.
std::optional<Recognition> recognisePlace(const std::vector<PlacePoint>& now,
                                          const std::vector<PlacePoint>& before, const Eigen::Vector3d& about,
                                          const Matrix6d& covariance);

/// Believes a place that is recognised when it is again from some way farther on, by other points.
class PlaceAgreement {
 public:
  /// `attempts` that agree, of which the last one has at least `least` matches that the first did not have.
  PlaceAgreement(int attempts, std::size_t least) : attempts_(attempts), least_(least) {}
  /// What recognition by looks needs.
  static PlaceAgreement byLooks() { return {3, 3}; }
  static constexpr double kWayByLooks = 0.15; ///< of the landmarks' distance, between the first and the last

  /// Whether `found`, from the vehicle's position `about` (world, m), confirms what was found before, at
  /// least `way` m before. Until all begins anew another one may.
  bool confirms(const Recognition& found, const Eigen::Vector3d& about, double way);
  /// What was confirmed is made use of, or the world is another one.
  void restart() { first_.reset(); }

 private:
  struct Attempt {
    Recognition recognition;
    Eigen::Vector3d about;
  };

  int attempts_;
  std::size_t least_;
  std::optional<Attempt> first_;
  int agreed_ = 0;
};

} // namespace vi_ekf_slam
