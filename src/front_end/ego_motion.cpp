#include "vi_ekf_slam/front_end/ego_motion.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/sensors/median.hpp"

namespace vi_ekf_slam {
namespace {

// px, of what counts as fitting, from coarse to fine; where the rotation is known, to the finest. Of a start
// in motion nothing is guessed, and half of the points may be farther off than the first.
constexpr double kCoarse = 8.0, kFine = 2.0, kFinest = 0.5;
constexpr int kRepeats = 2, kLastRepeats = 4; // of each scale, of the finest one
constexpr double kMinDepth = 0.1;             // m
constexpr double kLeastDisparity = 0.1;       // px
constexpr double kOtherwise = 1.0;            // px; two motions that turn by less are the same for tracks
constexpr double kExact = 0.3;                // px, three sigmas of a point from pair to pair

/// px, within which half of the points are where the motion puts them; infinite, where it puts them behind
/// the camera.
double medianDistance(const StereoCamera& camera, const std::vector<Displacement>& displacements,
                      const SE3& motion) {
  std::vector<double> distances;
  for (const Displacement& d : displacements) {
    const Eigen::Vector3d p = motion * d.before;
    distances.push_back(p.z() < kMinDepth ? std::numeric_limits<double>::infinity()
                                          : (d.now - camera.project(p).head<2>()).norm());
  }
  return medianOf(std::move(distances));
}

/// px, one for each iteration.
std::vector<double> scalesBetween(double coarsest, double finest) {
  std::vector<double> scales;
  for (double scale = coarsest; scale > finest; scale *= 0.5) scales.insert(scales.end(), kRepeats, scale);
  scales.insert(scales.end(), kLastRepeats, finest);
  return scales;
}

enum class Turns { kFreely, kAsGuessed };

/// What turns as it is guessed is taken to move nearly so, too, and a third of the points are enough.
std::optional<SE3> fitMotion(const StereoCamera& camera, const std::vector<Displacement>& displacements,
                             const SE3& guess, Turns turns) {
  if (displacements.size() < kFewestForMotion) return std::nullopt;
  const bool is_free = turns == Turns::kFreely;
  double coarsest = is_free ? kCoarse : kFine;
  if (is_free) {
    const double distance = medianDistance(camera, displacements, guess);
    if (!std::isfinite(distance)) return std::nullopt;
    while (coarsest < distance) coarsest *= 2.0;
  }
  SE3 motion = guess;
  std::size_t agreeing = 0;
  for (const double scale : scalesBetween(coarsest, is_free ? kFine : kFinest)) {
    Matrix6d H = Matrix6d::Zero();
    Vector6d b = Vector6d::Zero();
    agreeing = 0;
    for (const Displacement& d : displacements) {
      const Eigen::Vector3d p = motion * d.before;
      if (p.z() < kMinDepth) continue;
      const Eigen::Vector2d residual = d.now - camera.project(p).head<2>();
      const double share = scale * scale / (scale * scale + residual.squaredNorm());
      if (residual.norm() < std::max(scale, kFine)) ++agreeing;
      const Eigen::Matrix<double, 2, 6> J = camera.projectJacobian(p).topRows<2>() * se3::pointJacobian(p);
      H.noalias() += share * share * J.transpose() * J;
      b.noalias() += share * share * J.transpose() * residual;
    }
    if (agreeing < kFewestForMotion) return std::nullopt;
    H.diagonal().array() += 1e-9 * H.trace(); // translation along what no point shows
    if (is_free) {
      motion = SE3::Exp(H.ldlt().solve(b)) * motion;
    } else {
      const Eigen::Vector3d shift = H.topLeftCorner<3, 3>().ldlt().solve(b.head<3>());
      motion = {motion.rotation(), motion.translation() + shift};
    }
    if (!motion.matrix().allFinite()) return std::nullopt;
  }
  if ((is_free ? 2 : 3) * agreeing < displacements.size()) return std::nullopt;
  return motion.normalized();
}

/// px^2; what does not fit counts alike.
double misfitOf(const StereoCamera& camera, const std::vector<Displacement>& displacements,
                const SE3& motion) {
  double sum = 0.0;
  for (const Displacement& d : displacements) {
    const double distance = std::min(kExact, misfit(camera, d, motion));
    sum += distance * distance;
  }
  return sum;
}

} // namespace

Eigen::Vector3d pointBehind(const StereoCamera& camera, const cv::Point2d& left, double disparity) {
  const double depth = camera.fu * camera.baseline / std::max(disparity, kLeastDisparity);
  return {(left.x - camera.cu) / camera.fu * depth, (left.y - camera.cv) / camera.fv * depth, depth};
}

double disparityOf(const StereoCamera& camera, const Eigen::Vector3d& point) {
  return camera.fu * camera.baseline / point.z();
}

std::optional<SE3> estimateMotion(const StereoCamera& camera, const std::vector<Displacement>& displacements,
                                  const SE3& guess, const std::optional<SE3>& told) {
  const auto motion = fitMotion(camera, displacements, guess, Turns::kFreely);
  const auto as_told = told ? fitMotion(camera, displacements, *told, Turns::kAsGuessed) : std::nullopt;
  if (!motion || !as_told) return motion ? motion : as_told;
  const double angle = so3::Log(motion->rotation() * as_told->rotation().transpose()).norm();
  if (camera.fu * angle <= kOtherwise) return motion;
  const bool fits_better =
      misfitOf(camera, displacements, *motion) <= misfitOf(camera, displacements, *as_told);
  return fits_better ? motion : as_told;
}

/// The least r^2 + e^2 over errors e of the disparity d, with r = now - pi(q) - g e, and g = dpi/dd, of
/// dp/dd = -p / d.
double misfit(const StereoCamera& camera, const Displacement& displacement, const SE3& now_T_before) {
  const Eigen::Vector3d& p = displacement.before;
  const Eigen::Vector3d q = now_T_before * p;
  if (q.z() < kMinDepth) return std::numeric_limits<double>::infinity();
  const Eigen::Vector2d r = displacement.now - camera.project(q).head<2>();
  const Eigen::Vector2d g =
      camera.projectJacobian(q).topRows<2>() * (now_T_before.rotation() * p) / -disparityOf(camera, p);
  const double along = g.dot(r);
  return std::sqrt(r.squaredNorm() - along * along / (1.0 + g.squaredNorm()));
}

} // namespace vi_ekf_slam
