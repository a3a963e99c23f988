#include "vi_ekf_slam/core/loops/place_agreement.hpp"

#include <algorithm>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

// Ten points 20 m away that fit to 0.4 m tell the shift to 0.2 m and the turn to 0.01 rad: three standard
// deviations of the difference, and what the way between adds.
constexpr double kSameShift = 1.0;  // m, at the vehicle
constexpr double kSameTurn = 0.05;  // rad
constexpr double kForgotten = 20.0; // times the way after which the two would differ by what the way adds

} // namespace

bool PlaceAgreement::confirms(const Recognition& found, const Eigen::Vector3d& about, double way) {
  const auto begin = [&] {
    first_ = {found, about};
    agreed_ = 1;
    return false;
  };
  if (!first_) return begin();
  const double driven = (about - first_->about).norm();
  const SE3& a = first_->recognition.before_T_now;
  const SE3& b = found.before_T_now;
  if (driven > kForgotten * way || (a * about - b * about).norm() > kSameShift ||
      so3::Log(a.rotation().transpose() * b.rotation()).norm() > kSameTurn)
    return begin();
  ++agreed_;
  const auto& known = first_->recognition.matches;
  const auto is_new = [&known](const auto& match) {
    return std::none_of(known.begin(), known.end(), [&match](const auto& other) {
      return other.first == match.first || other.second == match.second;
    });
  };
  const auto others = std::count_if(found.matches.begin(), found.matches.end(), is_new);
  return driven >= way && agreed_ >= attempts_ && static_cast<std::size_t>(others) >= least_;
}

} // namespace vi_ekf_slam
