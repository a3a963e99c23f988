#include "vi_ekf_slam/simulation/inertial/quintic_spline.hpp"

#include <algorithm>

namespace vi_ekf_slam::simulation {
namespace {

/// The cardinal B-spline of a degree, on [0, degree + 1]: sum_k (-1)^k C(degree + 1, k) (x - k)_+^degree /
/// degree! (Schoenberg 1946), from its nearer end, where little cancels.
double cardinal(int degree, double x) {
  x = std::min(x, degree + 1.0 - x);
  double sum = 0.0, binomial = 1.0, factorial = 1.0;
  for (int k = 0; k < x; ++k) {
    sum += (k % 2 == 0 ? binomial : -binomial) * std::pow(x - k, degree);
    binomial *= (degree + 1.0 - k) / (k + 1.0);
  }
  for (int k = 2; k <= degree; ++k) factorial *= k;
  return sum / factorial;
}

} // namespace

SplineWeights::SplineWeights(double fraction) {
  for (int j = 0; j < 6; ++j) {
    const double x = fraction + 5.0 - j;
    rows(j, 0) = cardinal(5, x);
    rows(j, 1) = cardinal(4, x) - cardinal(4, x - 1.0);
    rows(j, 2) = cardinal(3, x) - 2.0 * cardinal(3, x - 1.0) + cardinal(3, x - 2.0);
  }
}

} // namespace vi_ekf_slam::simulation
