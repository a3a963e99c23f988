#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "vi_ekf_slam/simulation/scene.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kFacade = 9.0;         // m from the path to the houses on either side
constexpr double kBeyond = 130.0;       // m that a street runs on beyond a corner
constexpr double kPointsPerMetre = 6.0; // of a facade
constexpr double kPeriod = 40.0;        // m, of streets that repeat themselves

/// Whether the segment from a to b enters the axis-aligned box |x| < hx, |y| < hy (Liang and Barsky 1984).
bool crossesBox(const Eigen::Vector2d& a, const Eigen::Vector2d& b, double hx, double hy) {
  double enter = 0.0, leave = 1.0;
  const double half[2] = {hx, hy};
  for (int i = 0; i < 2; ++i) {
    const double d = b[i] - a[i];
    if (std::abs(d) < 1e-12) {
      if (std::abs(a[i]) >= half[i]) return false;
      continue;
    }
    const double t1 = (-half[i] - a[i]) / d, t2 = (half[i] - a[i]) / d;
    enter = std::max(enter, std::min(t1, t2));
    leave = std::min(leave, std::max(t1, t2));
  }
  return enter < leave;
}

} // namespace

StreetScene::StreetScene(const DriveOptions& options, const View& view)
    : PointScene(options, view),
      path_(options.block_length, options.block_width),
      path_T_world_(options.hasRawImu() ? SE3() : path_.path_T_imu(0.0)) {
  addFacades();
  addStreetsBeyond();
  addFurniture();
  if (options.alike_streets) repeatStreets();
  drawStrengths(options);
}

void StreetScene::add(double x, double y, double z) {
  points_.push_back(path_T_world_.inverse() * Eigen::Vector3d(x, y, z));
}

void StreetScene::addFacades() {
  for (const double offset : {-kFacade, kFacade}) {
    const double hx = 0.5 * path_.length() + offset, hy = 0.5 * path_.width() + offset;
    const int count = static_cast<int>(4.0 * (hx + hy) * kPointsPerMetre);
    for (int i = 0; i < count; ++i) {
      const bool along_x = random_.uniform() < hx / (hx + hy);
      const double t = random_.uniform(-1.0, 1.0), side = random_.sign();
      const double height = random_.uniform(0.3, 9.0);
      const double x = along_x ? t * hx : side * hx, y = along_x ? side * hy : t * hy;
      const double gap = along_x ? std::abs(std::abs(x) - 0.5 * path_.length())
                                 : std::abs(std::abs(y) - 0.5 * path_.width());
      if (offset > 0.0 && gap < kFacade) continue; // here a street goes on
      add(x, y, height);
    }
  }
}

void StreetScene::addStreetsBeyond() {
  const int count = static_cast<int>(8 * kBeyond * 0.5 * kPointsPerMetre);
  for (int i = 0; i < count; ++i) {
    const double along = kFacade + random_.uniform(0.0, kBeyond);
    const double across = kFacade * random_.sign();
    const double sx = random_.sign(), sy = random_.sign();
    const double height = random_.uniform(0.3, 9.0);
    const double hx = 0.5 * path_.length(), hy = 0.5 * path_.width();
    if (random_.uniform() < 0.5) {
      add(sx * (hx + along), sy * hy + across, height);
    } else {
      add(sx * hx + across, sy * (hy + along), height);
    }
  }
}

void StreetScene::addFurniture() {
  const auto place = [this](double s, double lateral, double height) {
    const Eigen::Vector2d p = path_.point(s), d = (path_.point(s + 0.1) - p).normalized();
    add(p.x() - lateral * d.y(), p.y() + lateral * d.x(), path_.height(s) + height);
  };
  for (double s = 0.0; s < path_.perimeter(); s += 1.0) { // kerbs, signs, parked cars
    for (int i = 0; i < 4; ++i) {
      const double at = s + random_.uniform(), lateral = random_.sign() * random_.uniform(3.0, 7.0);
      place(at, lateral, random_.uniform() < 0.5 ? random_.uniform(0.0, 0.2) : random_.uniform(0.3, 1.6));
    }
  }
  for (double s = 6.0; s < path_.perimeter(); s += 12.0) {
    const double pole = random_.sign() * random_.uniform(4.5, 6.0);
    for (int i = 0; i < 5; ++i) place(s, pole, random_.uniform(0.3, 6.0));
    const double tree = -pole * 1.2, at = s + random_.uniform(-4.0, 4.0);
    for (int i = 0; i < 14; ++i) {
      const Eigen::Vector3d leaf = random_.normal3();
      place(at + 0.8 * leaf.x(), tree + 0.8 * leaf.y(), 4.0 + leaf.z());
    }
  }
}

/// Of the first long street a part of kPeriod is everywhere along both of them, which run as far apart from
/// each other as the block is wide.
void StreetScene::repeatStreets() {
  const double half_length = 0.5 * path_.length(), half_width = 0.5 * path_.width();
  const auto isOfLongStreet = [&](const Eigen::Vector3d& p) {
    return std::abs(p.x()) < half_length - kFacade && std::abs(std::abs(p.y()) - half_width) < kFacade + 3.0;
  };
  std::vector<Eigen::Vector3d> part, others;
  for (const Eigen::Vector3d& world : points_) {
    const Eigen::Vector3d p = path_T_world_ * world;
    if (!isOfLongStreet(p))
      others.push_back(world);
    else if (std::abs(p.x()) < 0.5 * kPeriod && p.y() < 0.0)
      part.push_back(p);
  }
  points_ = std::move(others);
  looks_.resize(points_.size());
  std::iota(looks_.begin(), looks_.end(), std::uint64_t{0});
  const std::uint64_t own = looks_.size();
  const auto copies = static_cast<int>(half_length / kPeriod + 0.5);
  for (const double side : {1.0, -1.0}) { // the other street is this one, turned
    for (int copy = -copies; copy <= copies; ++copy) {
      for (std::size_t i = 0; i < part.size(); ++i) {
        const Eigen::Vector3d p(side * (part[i].x() + copy * kPeriod), side * part[i].y(), part[i].z());
        if (!isOfLongStreet(p)) continue;
        add(p.x(), p.y(), p.z());
        looks_.push_back(own + i);
      }
    }
  }
}

bool StreetScene::occluded(const Eigen::Vector3d& camera_world, const Eigen::Vector3d& point_world) const {
  const Eigen::Vector3d a = path_T_world_ * camera_world, b = path_T_world_ * point_world;
  constexpr double kSkin = 0.5; // m: the facade's own points are in front of the house
  return crossesBox(a.head<2>(), b.head<2>(), 0.5 * path_.length() - kFacade - kSkin,
                    0.5 * path_.width() - kFacade - kSkin);
}

} // namespace vi_ekf_slam::simulation
