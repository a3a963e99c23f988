#include "vi_ekf_slam/core/geometry/rigid_consensus.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kFewest = 5; // points that agree: three fit almost any motion, two more hardly ever do
constexpr double kBound = 13.93;   // chi-square, 3 degrees of freedom, 99.7 %
// Of three points; with a third of them wrong, 1 in 10^9 has none that are right. With a smaller share of
// right ones as many more as it takes to miss one in a thousand.
constexpr int kTries = 60;
constexpr double kMissed = 1e-3;
constexpr int kSteps = 4; // of Gauss and Newton

using Indices = std::vector<std::size_t>;

struct Weighted {
  const Displaced& point;
  Eigen::Matrix3d information;
};

/// Least squares over the chosen points of mean c, from the first one's shift: expected = c + t + R (seen -
/// c).
std::optional<SE3> fit(const std::vector<Weighted>& points, const Indices& chosen) {
  Eigen::Vector3d c = Eigen::Vector3d::Zero();
  for (const std::size_t i : chosen) c += points[i].point.seen / static_cast<double>(chosen.size());
  const Displaced& first = points[chosen.front()].point;
  Eigen::Vector3d t = first.expected - first.seen;
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  for (int step = 0; step < kSteps; ++step) {
    Matrix6d information = Matrix6d::Zero();
    Vector6d gradient = Vector6d::Zero();
    for (const std::size_t i : chosen) {
      const Eigen::Vector3d turned = R * (points[i].point.seen - c);
      const Eigen::Matrix<double, 3, 6> J = se3::pointJacobian(turned);
      const Eigen::Matrix<double, 6, 3> JtW = J.transpose() * points[i].information;
      information += JtW * J;
      gradient += JtW * (points[i].point.expected - c - t - turned);
    }
    const Vector6d delta = solvePositive(information, gradient);
    if (!delta.allFinite()) return std::nullopt;
    t += delta.head<3>();
    R = so3::Exp(delta.tail<3>()) * R;
  }
  return SE3(R, c + t - R * c).normalized();
}

std::vector<Weighted> weightedOf(const std::vector<Displaced>& points) {
  std::vector<Weighted> weighted;
  for (const Displaced& point : points)
    weighted.push_back({point, solvePositive(point.covariance, Eigen::Matrix3d::Identity().eval())});
  return weighted;
}

Indices agreeingWith(const std::vector<Weighted>& points, const SE3& motion) {
  Indices indices;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d residual = points[i].point.expected - motion * points[i].point.seen;
    if (residual.dot(points[i].information * residual) < kBound) indices.push_back(i);
  }
  return indices;
}

} // namespace

std::vector<std::size_t> agreeing(const std::vector<Displaced>& points, const SE3& motion) {
  return agreeingWith(weightedOf(points), motion);
}

std::optional<SE3> commonMotion(const std::vector<Displaced>& points, double share) {
  const std::size_t enough =
      std::max(kFewest, static_cast<std::size_t>(std::ceil(share * static_cast<double>(points.size()))));
  if (points.size() < enough) return std::nullopt;
  const std::vector<Weighted> weighted = weightedOf(points);
  // The nearer half decides: distant points know nothing of a shift.
  Indices order(points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&points](std::size_t a, std::size_t b) {
    return points[a].covariance.trace() < points[b].covariance.trace();
  });
  order.resize(std::max(kFewest, order.size() / 2));
  std::minstd_rand random(1);
  const int tries = std::max(
      kTries, static_cast<int>(std::ceil(std::log(kMissed) / std::log(1.0 - share * share * share))));
  Indices best;
  for (int i = 0; i < tries; ++i) {
    for (std::size_t k = 0; k < 3; ++k) std::swap(order[k], order[k + random() % (order.size() - k)]);
    const auto motion = fit(weighted, {order[0], order[1], order[2]});
    if (!motion) continue;
    Indices agree = agreeingWith(weighted, *motion);
    if (agree.size() > best.size()) best = std::move(agree);
  }
  std::optional<SE3> motion;
  for (int i = 0; i < 3 && best.size() >= 3; ++i) {
    motion = fit(weighted, best);
    if (!motion) return std::nullopt;
    best = agreeingWith(weighted, *motion);
  }
  return best.size() >= enough ? motion : std::nullopt;
}

} // namespace vi_ekf_slam
