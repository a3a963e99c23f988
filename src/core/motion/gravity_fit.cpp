#include "vi_ekf_slam/core/motion/gravity_fit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kLeastPoses = 4;
constexpr int kIterations = 5; // on the sphere of gravity's directions; three suffice from 45 deg

/// Twice integrated accelerations, and what a constant error of them makes of the result.
struct Integral {
  Eigen::Vector3d position = Eigen::Vector3d::Zero(), velocity = Eigen::Vector3d::Zero();
  Eigen::Matrix3d position_by_bias = Eigen::Matrix3d::Zero(), velocity_by_bias = Eigen::Matrix3d::Zero();

  void add(const Eigen::Matrix3d& R, const Eigen::Vector3d& phi, const Eigen::Vector3d& a, double dt) {
    const Eigen::Matrix3d once = dt * R * so3::leftJacobian(phi),
                          twice = dt * dt * R * so3::secondIntegral(phi);
    position += dt * velocity + twice * a;
    velocity += once * a;
    position_by_bias += dt * velocity_by_bias - twice;
    velocity_by_bias -= once;
  }
};

struct Equations {
  Eigen::MatrixXd A; ///< of (v_0, g, b_a, the error of p_0), whitened
  Eigen::VectorXd b;
};

/// The IMU from pose to pose: turns within by the gyro, from each pose on by the pose's own rotation.
Equations equationsOf(const std::vector<SeenPose>& poses, const std::vector<ImuSample>& samples,
                      const Eigen::Vector3d& gyro_bias) {
  const auto rows = 3 * static_cast<Eigen::Index>(poses.size() - 1);
  Equations e{Eigen::MatrixXd::Zero(rows, 12), Eigen::VectorXd(rows)};
  ImuTrack imu({}, false);
  Integral sum;
  auto next = samples.begin();
  while (next != samples.end() && next->stamp <= poses.front().stamp) imu.reach(*next++);
  for (std::size_t k = 0; k + 1 < poses.size(); ++k) {
    Eigen::Matrix3d R = poses[k].frame_T_imu.rotation();
    Stamp now = poses[k].stamp;
    while (now < poses[k + 1].stamp) {
      const bool more = next != samples.end();
      if (more) imu.expect(*next);
      const Stamp to = more ? std::min(next->stamp, poses[k + 1].stamp) : poses[k + 1].stamp;
      const double dt = secondsBetween(now, to);
      const ImuInterval input = imu.over(now, to);
      const Eigen::Vector3d phi = dt * (input.rate - gyro_bias);
      sum.add(R, phi, input.acceleration, dt);
      R *= so3::Exp(phi);
      now = to;
      if (more && next->stamp <= now) imu.reach(*next++);
    }
    const double t = secondsBetween(poses.front().stamp, now);
    const Eigen::Matrix3d weight = poses[k + 1].position_sigma.cwiseInverse().asDiagonal();
    const Eigen::Index row = 3 * static_cast<Eigen::Index>(k);
    e.A.block<3, 3>(row, 0) = weight * t;
    e.A.block<3, 3>(row, 3) = weight * 0.5 * t * t;
    e.A.block<3, 3>(row, 6) = weight * sum.position_by_bias;
    e.A.block<3, 3>(row, 9) = weight;
    e.b.segment<3>(row) = weight * (poses[k + 1].frame_T_imu.translation() -
                                    poses.front().frame_T_imu.translation() - sum.position);
  }
  return e;
}

} // namespace

std::optional<GravityFit> fitGravity(const std::vector<SeenPose>& poses,
                                     const std::vector<ImuSample>& samples, const Eigen::Vector3d& gyro_bias,
                                     double bias_sigma, double gravity) {
  if (poses.size() < kLeastPoses || samples.empty()) return std::nullopt;
  const Equations e = equationsOf(poses, samples, gyro_bias);
  Eigen::Matrix<double, 6, 1> prior;
  prior << Eigen::Vector3d::Constant(std::pow(bias_sigma, -2)),
      poses.front().position_sigma.array().square().inverse();
  Eigen::MatrixXd N = e.A.transpose() * e.A;
  N.diagonal().tail<6>() += prior;
  const Eigen::LLT<Eigen::MatrixXd> llt(N);
  if (llt.info() != Eigen::Success) return std::nullopt;
  Eigen::VectorXd x = llt.solve(e.A.transpose() * e.b);
  const Eigen::MatrixXd P = llt.solve(Eigen::MatrixXd::Identity(12, 12));
  GravityFit fit;
  Eigen::Vector3d down = x.segment<3>(3).normalized();
  fit.free_length = x.segment<3>(3).norm();
  fit.free_length_sigma = std::sqrt(down.dot(P.block<3, 3>(3, 3) * down));
  if (!x.allFinite() || !(fit.free_length > 0.0)) return std::nullopt;
  // g = gravity * (down + tangent d): two unknowns in the place of three.
  for (int i = 0; i < kIterations; ++i) {
    const Eigen::Vector3d t1 = down.unitOrthogonal(), t2 = down.cross(t1);
    Eigen::MatrixXd T = Eigen::MatrixXd::Zero(12, 11);
    T.topLeftCorner<3, 3>().setIdentity();
    T.bottomRightCorner<6, 6>().setIdentity();
    T.block<3, 1>(3, 3) = gravity * t1;
    T.block<3, 1>(3, 4) = gravity * t2;
    const Eigen::MatrixXd A = e.A * T;
    Eigen::MatrixXd M = A.transpose() * A;
    M.diagonal().tail<6>() += prior;
    const Eigen::LLT<Eigen::MatrixXd> solve(M);
    if (solve.info() != Eigen::Success) return std::nullopt;
    const Eigen::VectorXd b = e.b - e.A.middleCols<3>(3) * (gravity * down);
    const Eigen::VectorXd y = solve.solve(A.transpose() * b);
    if (!y.allFinite()) return std::nullopt;
    fit.misfit = std::sqrt((b - A * y).squaredNorm() / static_cast<double>(b.size()));
    down = (down + y[3] * t1 + y[4] * t2).normalized();
    fit.velocity = y.head<3>();
    const Eigen::MatrixXd Q = solve.solve(Eigen::MatrixXd::Identity(11, 11));
    fit.tilt_sigma = std::sqrt(std::max(Q(3, 3), Q(4, 4)));
  }
  fit.gravity = gravity * down;
  return fit;
}

} // namespace vi_ekf_slam
