#include "numeric.hpp"

namespace vi_ekf_slam::test {

double distance(const AnyMatrix& a, const AnyMatrix& b) { return (a - b).cwiseAbs().maxCoeff(); }

double distance(const AnyMatrix& a, const Eigen::Ref<const LongMatrix>& b) {
  return static_cast<double>((a.cast<long double>() - b).cwiseAbs().maxCoeff());
}

double relativeDistance(const AnyMatrix& a, const AnyMatrix& b) {
  return distance(a, b) / b.cwiseAbs().maxCoeff();
}

double relativeDistance(const AnyMatrix& a, const Eigen::Ref<const LongMatrix>& b) {
  return distance(a, b) / static_cast<double>(b.cwiseAbs().maxCoeff());
}

} // namespace vi_ekf_slam::test
