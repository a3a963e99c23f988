#pragma once

#include <optional>

#include "vi_ekf_slam/core/loops/place_recogniser.hpp"

namespace vi_ekf_slam {

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
