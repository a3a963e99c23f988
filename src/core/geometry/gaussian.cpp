#include "vi_ekf_slam/core/geometry/gaussian.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

namespace vi_ekf_slam {
namespace {

template <int N, int Columns>
Eigen::Matrix<double, N, Columns> solve(const Eigen::Matrix<double, N, N>& S,
                                        const Eigen::Matrix<double, N, Columns>& B) {
  const Eigen::LLT<Eigen::Matrix<double, N, N>> llt(S);
  if (llt.info() == Eigen::Success) return llt.solve(B);
  return Eigen::Matrix<double, N, Columns>::Constant(std::numeric_limits<double>::quiet_NaN());
}

} // namespace

Matrix6d anyPose(bool level) {
  Matrix6d any = independentPose(1e3, 2.0);
  if (level) any(3, 3) = any(4, 4) = 0.0;
  return any;
}

Matrix6d independentPose(double position_sigma, double rotation_sigma) {
  Vector6d sigma;
  sigma << Eigen::Vector3d::Constant(position_sigma), Eigen::Vector3d::Constant(rotation_sigma);
  return sigma.cwiseAbs2().asDiagonal();
}

Eigen::Vector3d solvePositive(const Eigen::Matrix3d& S, const Eigen::Vector3d& b) { return solve(S, b); }
Eigen::Matrix3d solvePositive(const Eigen::Matrix3d& S, const Eigen::Matrix3d& B) { return solve(S, B); }
Vector6d solvePositive(const Matrix6d& S, const Vector6d& b) { return solve(S, b); }

double squaredMahalanobis(const Eigen::Vector3d& e, const Eigen::Matrix3d& S) { return e.dot(solve(S, e)); }
double squaredMahalanobis(const Vector6d& e, const Matrix6d& S) { return e.dot(solve(S, e)); }

bool isPositiveDefinite(const Eigen::Matrix3d& S) {
  return S.allFinite() && S.llt().info() == Eigen::Success;
}

/// By its correlations, in whose units all pivots are alike.
bool isPositiveSemidefinite(const Eigen::Ref<const Eigen::MatrixXd>& S, double rounding) {
  const Eigen::VectorXd scale =
      S.diagonal().unaryExpr([](double v) { return v > 0.0 ? 1.0 / std::sqrt(v) : 0.0; });
  Eigen::MatrixXd correlation(S.rows(), S.cols());
  for (Eigen::Index column = 0; column < S.cols(); ++column) {
    const Eigen::Index below = S.rows() - column;
    correlation.col(column).tail(below) =
        scale[column] * scale.tail(below).cwiseProduct(S.col(column).tail(below));
  }
  correlation.diagonal().setConstant(1.0 + rounding);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> llt(correlation); // in its place
  return llt.info() == Eigen::Success;
}

} // namespace vi_ekf_slam
