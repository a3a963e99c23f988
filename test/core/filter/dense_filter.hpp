#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam::test {

/// The filter as plainly as it can be written: one dense covariance of all variables, active and inactive,
/// explicit Jacobians, Joseph's form, every step at once. Errors of points are along the world axes (d) while
/// they are inactive or a period of the core is under way, else relative to the body (y).
class DenseFilter {
 public:
  struct Variable {
    Handle handle;
    Chart chart;
    bool active;
    Eigen::VectorXd mean, linearised;
    Eigen::Index row;
  };

  DenseFilter(const SE3& pose, const Matrix6d& covariance) : pose_(pose), P_(covariance) {
    variables_.push_back({0, Chart::kPose, true, Eigen::VectorXd::Zero(6), {}, 0});
  }

  const SE3& pose() const { return pose_; }
  const Eigen::MatrixXd& covariance() const { return P_; }
  const std::vector<Variable>& variables() const { return variables_; }
  Variable& of(Handle handle) {
    return *std::find_if(variables_.begin(), variables_.end(),
                         [handle](const Variable& v) { return v.handle == handle; });
  }
  void closeCore() { core_rows_ = P_.rows(); }

  void propagate(const CoreStep& step) {
    open();
    Eigen::MatrixXd F = identity();
    F.block(step.row, step.row, step.F.rows(), step.F.cols()) = step.F;
    P_ = (F * P_ * F.transpose()).eval();
    P_.block(step.row, step.row, step.Q.rows(), step.Q.rows()) += step.Q;
    pose_ = step.pose;
    for (const auto& [handle, mean] : step.means) of(handle).mean = mean;
  }

  /// `core`: within a period of the core. Terms are of the active variables' rows here.
  void correct(const Eigen::MatrixXd& H, const Eigen::MatrixXd& R, const Eigen::VectorXd& residual,
               const PointChart& chart, bool core) {
    if (core)
      open();
    else
      settle();
    const Eigen::MatrixXd S = H * P_ * H.transpose() + R;
    const Eigen::MatrixXd K = S.llt().solve(H * P_).transpose();
    const Eigen::MatrixXd I_KH = identity() - K * H;
    P_ = (I_KH * P_ * I_KH.transpose() + K * R * K.transpose()).eval();
    const Eigen::VectorXd error = K * residual;
    const Eigen::Matrix3d turn = so3::Exp(error.segment<3>(3));
    const Eigen::Vector3d before = pose_.translation(), now = before + error.head<3>();
    Eigen::MatrixXd F = identity();
    const bool with_body = chart && !core && goWithBody(error);
    for (Variable& v : variables_) {
      const Eigen::VectorXd e = error.segment(v.row, v.mean.size());
      if (v.chart == Chart::kPose) continue;
      if (v.chart == Chart::kWorldVector && v.active) {
        v.mean = turn * (v.mean + e);
        F.block<3, 3>(v.row, v.row) = turn;
      } else if (v.chart == Chart::kBodyVector && v.active) {
        const Eigen::Matrix3d body_turn = pose_.rotation().transpose() * turn.transpose() * pose_.rotation();
        for (Eigen::Index k = 0; k < e.size(); k += 3) {
          v.mean.segment<3>(k) += body_turn * e.segment<3>(k);
          F.block<3, 3>(v.row + k, v.row + k) = body_turn;
        }
      } else if (v.chart == Chart::kPoint && v.active && !core) {
        const Eigen::Vector3d way = v.mean - before;
        const Eigen::Vector3d shift = error.head<3>(), d = e + so3::hat(error.segment<3>(3)) * way + shift;
        const auto moved = !chart      ? std::nullopt
                           : with_body ? chart.move(turn, turn * way, turn * e)
                                       : chart.move(turn, way - shift, d);
        v.mean = now + (moved ? moved->way : Eigen::Vector3d(turn * (way + e)));
        F.block<3, 3>(v.row, v.row) = turn;
        if (moved) F.block<3, 3>(v.row, v.row) = with_body ? Eigen::Matrix3d(moved->M * turn) : moved->M;
      } else {
        v.mean += e;
      }
    }
    pose_ = SE3(turn * pose_.rotation(), now).normalized();
    if (isLevel()) {
      F.block<3, 3>(3, 3) = so3::leftJacobian(error.segment<3>(3));
      F.block<3, 3>(3, 3).col(2) = Eigen::Vector3d::UnitZ();
    }
    F.block<3, 3>(0, 3) = -so3::hat(now - before) * F.block<3, 3>(3, 3);
    P_ = (F * P_ * F.transpose()).eval();
  }

  void augment(Handle handle, Chart chart, const Eigen::VectorXd& mean, const Eigen::MatrixXd& noise,
               const Eigen::MatrixXd& J) {
    settle();
    const Eigen::Index n = P_.rows(), k = mean.size();
    Eigen::MatrixXd F = Eigen::MatrixXd::Zero(n + k, n);
    F.topRows(n).setIdentity();
    F.bottomRows(k) = J;
    P_ = (F * P_ * F.transpose()).eval();
    P_.bottomRightCorner(k, k) += noise;
    variables_.push_back({handle, chart, true, mean, {}, n});
  }

  /// All errors and means move by G x of one variable.
  void moveBy(Handle by, const Eigen::MatrixXd& G) {
    settle();
    const Variable source = of(by);
    Eigen::MatrixXd F = identity();
    F.middleCols(source.row, G.cols()) += G;
    P_ = (F * P_ * F.transpose()).eval();
    for (Variable& v : variables_) {
      if (v.chart != Chart::kPose) v.mean += G.middleRows(v.row, v.mean.size()) * source.mean;
    }
  }

  void addNoise(Handle handle, const Eigen::MatrixXd& noise) {
    settle();
    const Variable& v = of(handle);
    P_.block(v.row, v.row, noise.rows(), noise.cols()) += noise;
  }

  void remove(Handle handle) {
    settle();
    const Variable gone = of(handle);
    const Eigen::Index n = P_.rows(), k = gone.mean.size();
    Eigen::MatrixXd F = Eigen::MatrixXd::Zero(n - k, n);
    F.leftCols(gone.row).topRows(gone.row).setIdentity();
    F.bottomRightCorner(n - k - gone.row, n - k - gone.row).setIdentity();
    P_ = (F * P_ * F.transpose()).eval();
    variables_.erase(std::find_if(variables_.begin(), variables_.end(),
                                  [handle](const Variable& v) { return v.handle == handle; }));
    for (Variable& v : variables_) {
      if (v.row > gone.row) v.row -= k;
    }
  }

  /// The pose of now, an inactive variable whose error is the pose's.
  void clonePose(Handle handle) {
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(6);
    mean.head<3>() = pose_.translation();
    settle();
    const Eigen::MatrixXd J = Eigen::MatrixXd::Identity(6, P_.rows());
    augment(handle, Chart::kVector, mean, Eigen::MatrixXd::Zero(6, 6), J);
    variables_.back().active = false;
  }

  void deactivate(Handle handle) {
    settle();
    Variable& v = of(handle);
    if (v.chart == Chart::kPoint) shift(v, -1.0, v.mean);
    v.linearised = v.mean;
    v.active = false;
  }

  void activate(Handle handle) {
    settle();
    Variable& v = of(handle);
    if (v.chart == Chart::kPoint) shift(v, 1.0, v.linearised);
    v.active = true;
  }

  void reset(Handle handle, const Eigen::MatrixXd& covariance) {
    settle();
    const Variable& v = of(handle);
    P_.middleRows(v.row, v.mean.size()).setZero();
    P_.middleCols(v.row, v.mean.size()).setZero();
    P_.block(v.row, v.row, v.mean.size(), v.mean.size()) = covariance;
  }

  void settle() {
    if (!open_) return;
    open_ = false;
    for (const Variable& v : variables_) {
      if (v.chart == Chart::kPoint && v.active) shift(v, 1.0, v.linearised);
    }
  }

 private:
  /// Whether a correction moves the points less about the body than in the world, as angles; with gravity.
  bool goWithBody(const Eigen::VectorXd& error) const {
    double in_body = 0.0, in_world = 0.0;
    for (const Variable& v : variables_) {
      if (v.chart != Chart::kPoint || !v.active) continue;
      const Eigen::Vector3d way = v.mean - pose_.translation(), y = error.segment<3>(v.row);
      const Eigen::Vector3d d = y + error.segment<3>(3).cross(way) + error.head<3>();
      in_body += way.cross(y).squaredNorm() / std::pow(way.norm(), 4);
      in_world += way.cross(d).squaredNorm() / std::pow(way.norm(), 4);
    }
    return isLevel() && in_body < in_world;
  }

  bool isLevel() const {
    return std::any_of(variables_.begin(), variables_.end(),
                       [](const Variable& v) { return v.chart == Chart::kWorldVector; });
  }

  Eigen::MatrixXd identity() const { return Eigen::MatrixXd::Identity(P_.rows(), P_.rows()); }

  /// error += sign byPose(point) (dp, theta)
  void shift(const Variable& v, double sign, const Eigen::Vector3d& point) {
    Eigen::MatrixXd F = identity();
    F.block<3, 6>(v.row, 0) += sign * byPose(point, pose_.translation());
    P_ = (F * P_ * F.transpose()).eval();
  }

  void open() {
    if (open_) return;
    open_ = true;
    for (Variable& v : variables_) {
      if (v.chart != Chart::kPoint || !v.active) continue;
      shift(v, -1.0, v.mean);
      v.linearised = v.mean;
    }
  }

  SE3 pose_;
  Eigen::MatrixXd P_;
  std::vector<Variable> variables_;
  Eigen::Index core_rows_ = 0;
  bool open_ = false;
};

} // namespace vi_ekf_slam::test
