#pragma once

#include <Eigen/Core>
#include <cmath>

namespace vi_ekf_slam::simulation {

/// A uniform B-spline of degree 5, of unit knot distance: four continuous derivatives. It smooths its control
/// points with a bell of standard deviation 0.7 instead of passing through them, keeps straight lines
/// straight and never turns back where they do not.
struct SplineWeights {
  /// Control points that count on either side: those of floor(u) - 2 to floor(u) + 3.
  static constexpr int kReach = 3;

  /// At u = floor(u) + `fraction`: columns: weights of the value and of its first and second derivative by u.
  explicit SplineWeights(double fraction);

  /// Row j is of control point floor(u) - 2 + j.
  Eigen::Matrix<double, 6, 3> rows;
};

/// The spline at `u` of the control points `control(i)`, numbers or vectors: the value and its derivatives.
template <class Value>
struct SplinePoint {
  Value value, rate, acceleration;

  template <class Control>
  SplinePoint(double u, const Value& zero, const Control& control)
      : value(zero), rate(zero), acceleration(zero) {
    const double whole = std::floor(u);
    const SplineWeights weights(u - whole);
    for (int j = 0; j < 6; ++j) {
      const Value point = control(static_cast<long>(whole) - 2 + j);
      value += weights.rows(j, 0) * point;
      rate += weights.rows(j, 1) * point;
      acceleration += weights.rows(j, 2) * point;
    }
  }
};

} // namespace vi_ekf_slam::simulation
