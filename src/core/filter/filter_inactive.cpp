// What Filter does with variables that are inactive, and with its errors along the world axes.

#include <Eigen/Geometry>
#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/filter/rigid_chain.hpp"
#include "vi_ekf_slam/core/filter/symmetric.hpp"

namespace vi_ekf_slam {

/// d = y - byPose (dp, theta): the error along the world axes, which does not change while the body moves.
void Filter::deactivate(Handle handle, const Eigen::Ref<const Eigen::MatrixXd>& noise) {
  settle();
  const Eigen::Index row = rowOf(handle), k = variables_.sizeOf(handle), n = rows();
  Eigen::MatrixXd D = Eigen::MatrixXd::Zero(k, 6);
  if (variables_.chartOf(handle) == Chart::kPoint)
    D = -byPose(variables_.point(handle), pose().translation());
  const auto P = covariance();
  Eigen::MatrixXd cross = P.middleCols(row, k);
  cross.noalias() += P.leftCols<6>() * D.transpose();
  Eigen::MatrixXd own = cross.middleRows(row, k) + noise;
  own.noalias() += D * cross.topRows<6>();
  own = (0.5 * (own + own.transpose())).eval();
  inactive_.add(handle, variables_.mean(handle), row, D, own, cross);
  erase(variables_.remove(handle, Variables::Fate::kKeepsHandle), n);
}

/// Its error along the world axes is the pose's own of now.
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
  inactive_.settle();
  const auto& variables = inactive_.variables();
  std::vector<std::size_t> index;
  Eigen::Index k = 0;
  for (const Handle handle : handles) {
    std::size_t i = 0;
    while (i < variables.size() && variables[i].handle != handle) ++i;
    if (i == variables.size())
      throw std::out_of_range("variable " + std::to_string(handle) + " is not inactive");
    index.push_back(i);
    k += variables[i].mean.size();
  }
  const Eigen::Index n = rows(), others = inactive_.rows();
  reserve(n + k);
  Eigen::MatrixXd E = Eigen::MatrixXd::Zero(k, 6), C(n, k), with_others(k, others);
  Eigen::MatrixXd own(k, k);
  Eigen::Index row = 0;
  for (const std::size_t i : index) {
    const Eigen::Index size = variables[i].mean.size(), from = inactive_.rowOf(i);
    if (variables_.chartOf(variables[i].handle) == Chart::kPoint)
      E.middleRows<3>(row) = byPose(variables[i].linearised, pose().translation());
    C.middleCols(row, size) = inactive_.cross().middleCols(from, size);
    with_others.middleRows(row, size) = inactive_.covariance().middleRows(from, size);
    Eigen::Index column = 0;
    for (const std::size_t j : index) {
      const Eigen::Index columns = variables[j].mean.size();
      own.block(row, column, size, columns) =
          inactive_.covariance().block(from, inactive_.rowOf(j), size, columns);
      column += columns;
    }
    row += size;
  }
  with_others.noalias() += E * inactive_.cross().topRows<6>();
  const auto P = covariance();
  const Eigen::MatrixXd EC = E * C.topRows<6>();
  own += EC + EC.transpose() + E * P.topLeftCorner<6, 6>() * E.transpose();
  const Eigen::MatrixXd cross = C.transpose() + E * P.topRows<6>();
  covariance_.block(n, 0, k, n) = cross;
  covariance_.block(0, n, n, k) = cross.transpose();
  covariance_.block(n, n, k, k) = 0.5 * (own + own.transpose());
  for (const std::size_t i : index) variables_.restore(variables[i].handle, variables[i].mean);
  inactive_.take(handles, with_others);
}

std::vector<Eigen::VectorXd> Filter::settledMeans() {
  inactive_.settle();
  std::vector<Eigen::VectorXd> means;
  for (const InactiveVariable& variable : inactive_.variables()) means.push_back(variable.mean);
  return means;
}

/// A correction that turns has moved the inactive points (and clones of the pose) from `before` to first order; they are to move
/// rigidly.
void Filter::moveInactive(const std::vector<Eigen::VectorXd>& before) {
  std::vector<Eigen::VectorXd> means = settledMeans();
  std::vector<std::size_t> index;
  std::vector<Eigen::Vector3d> points, corrections;
  for (std::size_t i = 0; i < means.size(); ++i) {
    const Chart chart = variables_.chartOf(inactive_.variables()[i].handle);
    if (chart != Chart::kPoint && chart != Chart::kPose) continue;
    index.push_back(i);
    points.emplace_back(before[i].head<3>());
    corrections.emplace_back(means[i].head<3>() - before[i].head<3>());
  }
  const std::vector<Eigen::Vector3d> moved = moveAsChain(points, corrections);
  for (std::size_t k = 0; k < index.size(); ++k) means[index[k]].head<3>() = moved[k];
  inactive_.setMeans(means);
}

std::vector<Handle> Filter::marginaliseOldest(std::size_t count) {
  settle();
  const std::vector<Handle> gone = inactive_.marginaliseOldest(count);
  for (const Handle handle : gone) variables_.release(handle);
  return gone;
}

void Filter::reset(Handle handle, const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  settle();
  const Eigen::Index row = rowOf(handle), k = variables_.sizeOf(handle);
  covariance_.block(row, 0, k, rows()).setZero();
  covariance_.block(0, row, rows(), k).setZero();
  covariance_.block(row, row, k, k) = covariance;
  inactive_.forget(row, k);
}

void Filter::fixPose(Eigen::Index row, double variance) {
  settle();
  covariance_.block(row, 0, 1, rows()).setZero();
  covariance_.block(0, row, rows(), 1).setZero();
  covariance_(row, row) = variance;
  inactive_.forget(row, 1);
}

void Filter::moveWorld(const SE3& to_T_world) {
  settle();
  if (!inactive_.isEmpty()) throw std::logic_error("a world with inactive variables cannot be moved");
  const Eigen::Matrix3d& R = to_T_world.rotation();
  onBothSides(P(), [&](Eigen::Ref<Eigen::MatrixXd> half) {
    const auto turn = [&](Eigen::Index row) {
      half.middleRows<3>(row) = (R * half.middleRows<3>(row)).eval();
    };
    for (const Handle handle : variables_.handles()) {
      const Eigen::Index row = rowOf(handle);
      if (variables_.chartOf(handle) == Chart::kVector) continue;
      turn(row);
      if (variables_.chartOf(handle) == Chart::kPose) turn(row + 3);
    }
  });
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

Eigen::MatrixXd Filter::worldCovariance() const {
  Eigen::MatrixXd result = covariance();
  const Eigen::MatrixXd X = poseInfluence(pose().translation());
  onBothSides(result, [&X](Eigen::Ref<Eigen::MatrixXd> half) {
    const Eigen::MatrixXd by_pose = X * half.topRows<6>();
    half -= by_pose;
  });
  return result;
}

Eigen::MatrixXd Filter::worldCross() const {
  Eigen::MatrixXd cross = inactive_.cross();
  const Eigen::MatrixXd by_pose = poseInfluence(pose().translation()) * cross.topRows<6>();
  return cross - by_pose;
}

void Filter::setCoreCovariance(const Eigen::Ref<const Eigen::MatrixXd>& covariance) {
  if (rows() != core_rows_ || covariance.rows() != core_rows_)
    throw std::logic_error("the core's covariance is set before anything is added to it");
  settle();
  covariance_.topLeftCorner(core_rows_, core_rows_) = covariance;
}

} // namespace vi_ekf_slam
