// What Filter does with variables that are inactive, and with the world's frame.

#include <Eigen/Geometry>
#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/filter/rigid_chain.hpp"
#include "vi_ekf_slam/core/filter/symmetric.hpp"

namespace vi_ekf_slam {

/// d = y - byPose (dp, theta): the error along the world axes, which does not change while the body moves.
void Filter::deactivate(Handle handle) {
  settle();
  const Eigen::Index row = rowOf(handle), k = variables_.sizeOf(handle), n = rows();
  Eigen::MatrixXd D = Eigen::MatrixXd::Zero(k, 6);
  if (variables_.chartOf(handle) == Chart::kPoint)
    D = -byPose(variables_.point(handle), pose().translation());
  const auto P = covariance();
  Eigen::MatrixXd cross = P.middleCols(row, k);
  cross.noalias() += P.leftCols<6>() * D.transpose();
  Eigen::MatrixXd own = cross.middleRows(row, k);
  own.noalias() += D * cross.topRows<6>();
  own = (0.5 * (own + own.transpose())).eval();
  inactive_.add(handle, variables_.mean(handle), row, D, own, cross);
  erase(variables_.remove(handle, Variables::Fate::kKeepsHandle), n);
}

Handle Filter::clonePose() {
  settle();
  const Handle handle = variables_.reserve(Chart::kPose);
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(6);
  mean.head<3>() = pose().translation();
  const auto P = covariance();
  inactive_.add(handle, mean, 0, Eigen::MatrixXd::Zero(6, 6), P.topLeftCorner<6, 6>(), P.leftCols<6>(),
                false);
  return handle;
}

/// y = d + byPose (dp, theta), about the point where it was made inactive.
void Filter::activate(const std::vector<Handle>& handles) {
  if (handles.empty()) return;
  settle();
  const InactiveStore::Taken taken = inactive_.take(handles);
  const Eigen::Index n = rows(), k = taken.cross.cols();
  reserve(n + k);
  Eigen::MatrixXd E = Eigen::MatrixXd::Zero(k, 6);
  Eigen::Index row = 0;
  for (const InactiveVariable& variable : taken.variables) {
    if (variables_.chartOf(variable.handle) == Chart::kPoint)
      E.middleRows<3>(row) = byPose(variable.linearised, pose().translation());
    row += variable.mean.size();
  }
  const auto P = covariance();
  const Eigen::MatrixXd EC = E * taken.cross.topRows<6>();
  const Eigen::MatrixXd own =
      taken.covariance + EC + EC.transpose() + E * P.topLeftCorner<6, 6>() * E.transpose();
  const Eigen::MatrixXd cross = taken.cross.transpose() + E * P.topRows<6>();
  covariance_.block(n, 0, k, n) = cross;
  covariance_.block(0, n, n, k) = cross.transpose();
  covariance_.block(n, n, k, k) = 0.5 * (own + own.transpose());
  for (const InactiveVariable& variable : taken.variables) variables_.restore(variable.handle, variable.mean);
  inactive_.transform([&](auto X) { X.bottomRows(k).noalias() += E * X.template topRows<6>(); });
}

/// A correction that turns has moved the inactive points (and clones of the pose) from `before` to first
/// order; they are to move rigidly.
void Filter::moveInactive(const std::vector<InactiveStore::Estimate>& before) {
  std::vector<SmallVector> by;
  std::vector<std::size_t> index;
  std::vector<Eigen::Vector3d> points, corrections;
  for (const InactiveStore::Estimate& now : inactive_.estimates(false)) {
    const SmallVector &mean = now.variable.mean, &was = before[by.size()].variable.mean;
    by.emplace_back(SmallVector::Zero(mean.size()));
    const Chart chart = variables_.chartOf(now.variable.handle);
    if (chart != Chart::kPoint && chart != Chart::kPose) continue;
    index.push_back(by.size() - 1);
    points.emplace_back(was.head<3>());
    corrections.emplace_back(mean.head<3>() - was.head<3>());
  }
  const std::vector<Eigen::Vector3d> moved = moveAsChain(points, corrections);
  for (std::size_t k = 0; k < index.size(); ++k)
    by[index[k]].head<3>() = moved[k] - points[k] - corrections[k];
  inactive_.move(by);
}

std::vector<Handle> Filter::marginaliseOldest(std::size_t count) {
  settle();
  const std::vector<Handle> gone = inactive_.marginaliseOldest(count);
  for (const Handle handle : gone) variables_.release(handle);
  return gone;
}

void Filter::makeIndependent(Eigen::Index row, const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  settle();
  const Eigen::Index k = covariance.rows();
  covariance_.block(row, 0, k, rows()).setZero();
  covariance_.block(0, row, rows(), k).setZero();
  covariance_.block(row, row, k, k) = covariance;
  inactive_.forget(row, k);
}

void Filter::moveWorld(const SE3& to_T_world) {
  settle();
  if (!inactive_.isEmpty()) throw std::logic_error("a world with inactive variables cannot be moved");
  auto all = P();
  const auto turnRows = [&] {
    const auto turn = [&](Eigen::Index row) {
      all.middleRows<3>(row) = (to_T_world.rotation() * all.middleRows<3>(row)).eval();
    };
    for (const Handle handle : variables_.handles()) {
      const Eigen::Index row = rowOf(handle);
      const Chart chart = variables_.chartOf(handle);
      if (chart == Chart::kVector || chart == Chart::kBodyVector) continue;
      turn(row);
      if (chart == Chart::kPose) turn(row + 3);
    }
  };
  turnRows();
  all.transposeInPlace();
  turnRows();
  mirrorLower(all);
  variables_.moveWorld(to_T_world);
}

std::vector<Handle> Filter::adopt(const std::vector<Eigen::Vector3d>& points,
                                  const Eigen::MatrixXd& covariance, Eigen::MatrixXd cross) {
  settle();
  for (const Handle handle : inactive_.handles()) variables_.release(handle);
  std::vector<InactiveVariable> adopted;
  std::vector<Handle> handles;
  for (const Eigen::Vector3d& point : points) {
    handles.push_back(variables_.reserve(Chart::kPoint));
    adopted.push_back({handles.back(), point, point});
  }
  inactive_.adopt(std::move(adopted), covariance, std::move(cross));
  return handles;
}

void Filter::setCoreCovariance(const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  if (rows() != core_rows_ || covariance.rows() != core_rows_)
    throw std::logic_error("the core's covariance is set before anything is added to it");
  settle();
  covariance_.topLeftCorner(core_rows_, core_rows_) = covariance;
}

} // namespace vi_ekf_slam
