#pragma once

#include <Eigen/LU>
#include <cmath>
#include <map>
#include <vector>

#include "../exp_series.hpp"
#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/slam/config.hpp"

/// The paper's filter written as plainly as its equations stand, with 4x4 matrices, explicit inverses, dense
/// covariances and long double: what the package's own, faster forms have to reproduce.
namespace vi_ekf_slam::test {

using Real = long double;
using Vec = Eigen::Matrix<Real, Eigen::Dynamic, 1>;
using Mat = LongMatrix;

constexpr double kStep = 0.1; ///< s, between the frames of these tests

/// Equation 12, u^wedge.
inline Mat hat4(const Vec& u) {
  Mat m = Mat::Zero(4, 4);
  m(0, 1) = -u[5];
  m(0, 2) = u[4];
  m(1, 0) = u[5];
  m(1, 2) = -u[3];
  m(2, 0) = -u[4];
  m(2, 1) = u[3];
  m.topRightCorner(3, 1) = u.head(3);
  return m;
}

/// Equation 12, u^curlywedge.
inline Mat curly6(const Vec& u) {
  Vec turned = Vec::Zero(6);
  turned.tail(3) = u.head(3);
  Mat m = Mat::Zero(6, 6);
  m.topLeftCorner(3, 3) = hat4(u).topLeftCorner(3, 3);
  m.bottomRightCorner(3, 3) = m.topLeftCorner(3, 3);
  m.topRightCorner(3, 3) = hat4(turned).topLeftCorner(3, 3);
  return m;
}

/// Equation 4.
inline Mat calibration(const StereoCamera& c) {
  Mat M(4, 4);
  M << c.fu, 0, c.cu, 0, 0, c.fv, c.cv, 0, c.fu, 0, c.cu, -Real(c.fu) * c.baseline, 0, c.fv, c.cv, 0;
  return M;
}

/// Equation 14.
inline Vec pi(const Vec& q) { return q / q[2]; }
inline Mat dpi(const Vec& q) {
  Mat D(4, 4);
  D << 1, 0, -q[0] / q[2], 0, 0, 1, -q[1] / q[2], 0, 0, 0, 0, 0, 0, 0, -q[3] / q[2], 1;
  return D / q[2];
}

inline Vec homogeneous(const Vec& m) {
  Vec h(4);
  h << m, Real(1);
  return h;
}

/// The operator of equation 19: hat(xi) x = odot(x) xi.
inline Mat odot4(const Vec& x) {
  Mat m = Mat::Zero(4, 6);
  for (int i = 0; i < 6; ++i) m.col(i) = hat4(Vec::Unit(6, i)) * x;
  return m;
}

/// Equations 6 (its third row repaired), 7 and 8.
inline Vec initialPoint(const StereoRig& rig, const Mat& U, const Vec& z) {
  const StereoCamera& c = rig.camera;
  const Real depth = Real(c.fu) * c.baseline / (z[0] - z[2]);
  Vec x(4);
  x << (z[0] - c.cu) / c.fu * depth, ((z[1] + z[3]) / 2 - c.cv) / c.fv * depth, depth, 1;
  const Mat oTw = rig.cam_T_imu.matrix().cast<Real>() * U;
  return (oTw.inverse() * x).head(3);
}

/// Joint EKF, the pose first: equations 9 to 20 with the dense update.
class DenseFilter {
 public:
  DenseFilter(const StereoRig& rig, const PaperConfig& config, bool pose_is_known)
      : rig_(rig), config_(config), pose_is_known_(pose_is_known) {
    if (!pose_is_known_) Sigma = Real(config.prior_pose_variance) * Mat::Identity(6, 6);
  }

  void predict(const Vector6d& u, double tau, const Matrix6d& W) {
    const Vec step = -Real(tau) * u.cast<Real>();
    U = expSeries(hat4(step)) * U;
    if (pose_is_known_) return;
    Mat F = Mat::Identity(Sigma.rows(), Sigma.cols());
    F.topLeftCorner(6, 6) = expSeries(curly6(step));
    Sigma = F * Sigma * F.transpose();
    Sigma.topLeftCorner(6, 6) += W.cast<Real>();
  }

  void update(const StereoFrame& frame) {
    const Mat M = calibration(rig_.camera), oTi = rig_.cam_T_imu.matrix().cast<Real>();
    const Eigen::Index n = Sigma.rows(), pose = pose_is_known_ ? 0 : 6;
    Mat P = Mat::Zero(3, 4); // the paper's P^T cuts the homogeneous coordinate
    P.leftCols(3).setIdentity();
    Mat H(0, n);
    Vec innovation(0);
    std::vector<StereoFeatureObservation> fresh;
    for (const auto& feature : frame.features) {
      const auto known = index.find(feature.id);
      if (known == index.end()) {
        fresh.push_back(feature);
        continue;
      }
      const Eigen::Index at = pose + 3 * known->second;
      const Vec m = homogeneous(mean.segment(3 * known->second, 3));
      const Vec q = oTi * U * m;
      if (q[2] < config_.min_depth_m) continue;
      const Eigen::Index row = H.rows();
      H.conservativeResize(row + 4, n);
      H.bottomRows(4).setZero();
      H.block(row, at, 4, 3) = M * dpi(q) * oTi * U * P.transpose();
      if (!pose_is_known_) H.block(row, 0, 4, 6) = M * dpi(q) * oTi * odot4(U * m);
      innovation.conservativeResize(row + 4);
      innovation.tail(4) = feature.pixels.cast<Real>() - M * pi(q);
    }
    if (H.rows() > 0) {
      const Mat V = Real(config_.pixel_noise) * Mat::Identity(H.rows(), H.rows());
      const Mat S = H * Sigma * H.transpose() + V;
      const Mat K = Sigma * H.transpose() * S.inverse();
      const Vec correction = K * innovation;
      if (!pose_is_known_) U = expSeries(hat4(correction.head(6))) * U;
      mean += correction.tail(mean.size());
      Sigma = ((Mat::Identity(n, n) - K * H) * Sigma).eval();
    }
    for (const auto& feature : fresh) {
      const Vec m = initialPoint(rig_, U, feature.pixels.cast<Real>());
      index[feature.id] = mean.size() / 3;
      mean.conservativeResize(mean.size() + 3);
      mean.tail(3) = m;
      const Eigen::Index size = Sigma.rows();
      Mat larger = Mat::Zero(size + 3, size + 3);
      larger.topLeftCorner(size, size) = Sigma;
      larger.bottomRightCorner(3, 3) = Real(config_.prior_landmark_variance) * Mat::Identity(3, 3);
      Sigma = larger;
    }
  }

  Mat U = Mat::Identity(4, 4);
  Mat Sigma = Mat::Zero(0, 0);
  Vec mean = Vec::Zero(0);
  std::map<FeatureId, Eigen::Index> index; ///< landmark number, in the order in which they entered

 private:
  StereoRig rig_;
  PaperConfig config_;
  bool pose_is_known_;
};

} // namespace vi_ekf_slam::test
