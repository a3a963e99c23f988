#include "vi_ekf_slam/core/map/pose_clones.hpp"

#include <algorithm>
#include <cstdlib>
#include <unordered_map>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

// Between two clones the path is corrected in proportion: what a loop corrects changes over tens of metres.
constexpr double kBetweenClones = 5.0; // m
constexpr double kTurnBetween = 0.5;   // rad
// rad, standard deviation of what is learnt of the attitude (the start from rest), which is no correction in
// proportion.
constexpr double kLearnt = 0.001;
constexpr std::size_t kMostArchived = 20000; // beyond it every second one is dropped
constexpr std::size_t kMostLoops = 10000;    // the last ones

} // namespace

void PoseClones::add(Filter& filter, Stamp now) {
  if (follows_ && !clones_.empty()) {
    const SE3 since = clones_.back().node.after.inverse() * filter.pose();
    const Matrix6d fallen = clones_.back().node.covariance - filter.covariance().topLeftCorner<6, 6>();
    const double learnt = fallen.diagonal().tail<3>().maxCoeff();
    if (since.translation().norm() < kBetweenClones && so3::Log(since.rotation()).norm() < kTurnBetween &&
        learnt < kLearnt * kLearnt)
      return;
  }
  append(filter, now);
}

PathNode PoseClones::nodeOf(const Filter& filter, Stamp now) const {
  PathNode node;
  node.stamp = now;
  node.before = node.after = node.now = filter.pose();
  node.covariance_soon = node.covariance = filter.covariance().topLeftCorner<6, 6>();
  node.follows = follows_;
  return node;
}

void PoseClones::append(Filter& filter, Stamp now) {
  if (!clones_.empty()) {
    filter.settle();
    Clone& last = clones_.back();
    last.node.covariance_soon = filter.inactive().related(last.variable).estimate.covariance;
  }
  const PathNode node = nodeOf(filter, now);
  follows_ = true;
  clones_.push_back({filter.clonePose(), node, filter.pose().rotation()});
}

/// Means of a clone are its position, and how it was turned since.
PathNode PoseClones::moved(const Clone& clone, const InactiveStore::Estimate& estimate) const {
  const SmallVector& mean = estimate.variable.mean;
  PathNode moved = clone.node;
  moved.now = SE3(so3::Exp(mean.tail<3>()) * clone.rotation, mean.head<3>()).normalized();
  moved.covariance = estimate.covariance;
  if (clone.variable == clones_.back().variable) moved.covariance_soon = moved.covariance;
  return moved;
}

void PoseClones::archive(const std::vector<InactiveStore::Estimate>& gone) {
  std::unordered_map<Handle, const InactiveStore::Estimate*> by_handle;
  for (const auto& estimate : gone) by_handle.emplace(estimate.variable.handle, &estimate);
  // They leave in the order in which they came.
  for (; !clones_.empty(); clones_.pop_front()) {
    const auto found = by_handle.find(clones_.front().variable);
    if (found == by_handle.end()) break;
    archive_.push_back(moved(clones_.front(), *found->second));
  }
  if (archive_.size() <= kMostArchived) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < archive_.size(); ++i) {
    const bool borders = !archive_[i].follows || (i + 1 < archive_.size() && !archive_[i + 1].follows);
    if (i % 2 == 0 || borders) archive_[kept++] = archive_[i];
  }
  archive_.resize(kept);
}

/// With errors (dp, theta) of both poses, about the axes of the one before:
/// dp = R^T (dp_now - dp_before + [p_now - p_before]x theta_before), theta = R^T (theta_now - theta_before).
std::optional<ClosedLoop> PoseClones::close(Filter& filter, Stamp now, const SE3& before,
                                            const Matrix6d& covariance, Stamp last, std::size_t landmarks) {
  const Matrix6d learned = covariance - filter.covariance().topLeftCorner<6, 6>();
  if (clones_.empty() || clones_.back().node.stamp != now) {
    append(filter, now);
    // The loop has told nearly the same of the one before.
    if (clones_.size() > 1) std::prev(clones_.end(), 2)->node.covariance_soon += learned;
  }
  clones_.back().node.before = before;
  clones_.back().node.after = filter.pose();
  clones_.back().node.learned = learned;
  if (clones_.size() < 2) return std::nullopt;
  const auto then =
      std::min_element(clones_.begin(), std::prev(clones_.end()), [last](const Clone& a, const Clone& b) {
        return std::llabs(a.node.stamp - last) < std::llabs(b.node.stamp - last);
      });
  // Earlier than the first clone: by another drive, or where the path is not known to the filter any more.
  if (last < clones_.front().node.stamp) return std::nullopt;
  filter.settle();
  const InactiveStore::Related related = filter.inactive().related(then->variable);
  const SE3 there = moved(*then, related.estimate).now;
  ClosedLoop closure;
  closure.ends = {then->node.stamp, now};
  closure.before_T_now = there.inverse() * filter.pose();
  closure.landmarks = landmarks;
  Eigen::Matrix<double, 12, 12> joint;
  joint << filter.covariance().topLeftCorner<6, 6>(), related.cross.topRows<6>(),
      related.cross.topRows<6>().transpose(), related.estimate.covariance;
  Eigen::Matrix<double, 6, 12> J = Eigen::Matrix<double, 6, 12>::Zero();
  J.leftCols<6>().setIdentity();
  J.rightCols<6>() = -Matrix6d::Identity();
  J.topRightCorner<3, 3>() = so3::hat(filter.pose().translation() - there.translation());
  Matrix6d axes = Matrix6d::Zero();
  axes.topLeftCorner<3, 3>() = axes.bottomRightCorner<3, 3>() = there.rotation().transpose();
  closure.covariance = axes * J * joint * J.transpose() * axes.transpose();
  if (loops_.size() == kMostLoops) loops_.erase(loops_.begin(), loops_.begin() + kMostLoops / 2);
  loops_.push_back(closure.ends);
  return closure;
}

PathEstimate PoseClones::estimate(const Filter& filter, const std::vector<InactiveStore::Estimate>& inactive,
                                  Stamp now) const {
  std::unordered_map<Handle, const InactiveStore::Estimate*> by_handle;
  for (const auto& estimate : inactive) by_handle.emplace(estimate.variable.handle, &estimate);
  PathEstimate path{archive_, loops_};
  for (const Clone& clone : clones_) path.nodes.push_back(moved(clone, *by_handle.at(clone.variable)));
  if (!path.nodes.empty() && path.nodes.back().stamp == now) return path;
  path.nodes.push_back(nodeOf(filter, now));
  return path;
}

} // namespace vi_ekf_slam
