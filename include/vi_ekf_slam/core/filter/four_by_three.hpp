#pragma once

#include <Eigen/Core>

namespace vi_ekf_slam {

/// A 3 x 3 matrix with a row of zeros below, so that its columns fill a vector register: a frame multiplies
/// some thousand of them by three numbers each.
class FourByThree {
 public:
  template <class Matrix>
  explicit FourByThree(const Matrix& M) {
    columns_.setZero();
    columns_.topRows<3>() = M;
  }

  template <class Vector>
  Eigen::Vector3d times(const Vector& x) const {
    const Eigen::Vector4d y = columns_.col(0) * x[0] + columns_.col(1) * x[1] + columns_.col(2) * x[2];
    return y.head<3>();
  }

 private:
  Eigen::Matrix<double, 4, 3> columns_;
};

} // namespace vi_ekf_slam
