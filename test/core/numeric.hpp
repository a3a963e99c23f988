#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam::test {

/// Numbers from a fixed seed, so that a failure comes back.
class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}

  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }

  template <int N>
  Eigen::Matrix<double, N, 1> vector(double low, double high) {
    Eigen::Matrix<double, N, 1> v;
    for (int i = 0; i < N; ++i) v[i] = uniform(low, high);
    return v;
  }

  /// Independent normal numbers of standard deviation `sigma`.
  template <int N>
  Eigen::Matrix<double, N, 1> gaussian(double sigma) {
    std::normal_distribution<double> draw;
    Eigen::Matrix<double, N, 1> v;
    for (int i = 0; i < N; ++i) v[i] = sigma * draw(engine_);
    return v;
  }

  Eigen::Vector3d direction() {
    Eigen::Vector3d v = vector<3>(-1.0, 1.0);
    while (v.norm() < 0.1) v = vector<3>(-1.0, 1.0);
    return v.normalized();
  }

  /// A well-conditioned symmetric positive definite matrix.
  template <int N>
  Eigen::Matrix<double, N, N> covariance() {
    Eigen::Matrix<double, N, N> A;
    for (int i = 0; i < A.size(); ++i) A(i) = uniform(-1.0, 1.0);
    return A * A.transpose() + 0.1 * Eigen::Matrix<double, N, N>::Identity();
  }

  std::mt19937& engine() { return engine_; }

 private:
  std::mt19937 engine_;
};

/// Derivative of f: R^Cols -> R^Rows at x by the five-point stencil, error O(h^4).
template <int Rows, int Cols, typename F>
Eigen::Matrix<double, Rows, Cols> numericJacobian(const F& f, const Eigen::Matrix<double, Cols, 1>& x,
                                                  double h = 1e-3) {
  Eigen::Matrix<double, Rows, Cols> J;
  for (int i = 0; i < Cols; ++i) {
    const auto at = [&](double step) -> Eigen::Matrix<double, Rows, 1> {
      Eigen::Matrix<double, Cols, 1> moved = x;
      moved[i] += step;
      return f(moved);
    };
    J.col(i) = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
  }
  return J;
}

using AnyMatrix = Eigen::Ref<const Eigen::MatrixXd>;
using LongMatrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;

/// Largest difference between two matrices. (One function for all: a template takes its time for each pair of
/// types.)
double distance(const AnyMatrix& a, const AnyMatrix& b);
double distance(const AnyMatrix& a, const Eigen::Ref<const LongMatrix>& b);

/// `distance` in units of the largest element of `b`.
double relativeDistance(const AnyMatrix& a, const AnyMatrix& b);
double relativeDistance(const AnyMatrix& a, const Eigen::Ref<const LongMatrix>& b);

} // namespace vi_ekf_slam::test
