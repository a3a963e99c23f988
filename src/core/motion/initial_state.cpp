#include "vi_ekf_slam/core/motion/initial_state.hpp"

#include <Eigen/Cholesky>

#include "vi_ekf_slam/core/sensors/arrivals.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kFarthest = 1e7;         // m; a vehicle's map is on the Earth
constexpr double kLargestGyroBias = 10.0; // rad/s
constexpr double kLargestBias = 100.0;    // m/s^2
constexpr double kAsymmetry = 1e-6;       // of the largest entry: rounding of text

} // namespace

std::optional<BadField> badFieldOf(const InitialState& state) {
  struct Vector {
    const char* name;
    const Eigen::Vector3d& value;
    double limit;
    const char* unit;
  };
  for (const Vector& v : {Vector{"position", state.world_T_imu.translation(), kFarthest, "m"},
                          Vector{"velocity", state.velocity, kMaxSpeed, "m/s"},
                          Vector{"gyro_bias", state.gyro_bias, kLargestGyroBias, "rad/s"},
                          Vector{"accelerometer_bias", state.accelerometer_bias, kLargestBias, "m/s^2"}}) {
    const double norm = v.value.norm();
    if (!(norm <= v.limit))
      return BadField{v.name, "of norm " + rounded(norm),
                      "finite, of a norm of at most " + rounded(v.limit) + " " + v.unit};
  }
  const auto& P = state.covariance;
  const double asymmetry = (P - P.transpose()).cwiseAbs().maxCoeff();
  if (!P.allFinite() || asymmetry > kAsymmetry * P.cwiseAbs().maxCoeff() || P.llt().info() != Eigen::Success)
    return BadField{"covariance", "not one", "225 numbers of a symmetric positive definite 15 x 15 matrix"};
  return std::nullopt;
}

} // namespace vi_ekf_slam
