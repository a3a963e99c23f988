#include "vi_ekf_slam/core/invariant/twin_fusion.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/invariant/chosen_blocks.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr double kGate = 11.345; // chi-square, 3 degrees of freedom, 99 %
// Wider, since what the twins have in common is an error of the way since, which is not quite normal; that
// they agree is what speaks for them.
constexpr double kCommonGate = 4.0 * kGate;
constexpr double kJointGate = 5.0; // of the joint chi-square, per degree of freedom

Eigen::Index rowOf(std::size_t twin) { return 3 * static_cast<Eigen::Index>(twin); }

/// The twins that agree, each by itself and once `h` is believed.
PooledVector<bool> agreeing(const PooledMatrix& S, const Pooled<Eigen::VectorXd>& innovation, std::size_t h) {
  const Eigen::Index column = rowOf(h);
  const Eigen::Matrix3d own = S.block<3, 3>(column, column);
  const Eigen::Vector3d own_innovation = innovation.segment<3>(column);
  const Eigen::Vector3d weighted = solvePositive(own, own_innovation);
  PooledVector<bool> agrees(static_cast<std::size_t>(S.rows() / 3), false);
  if (!(own_innovation.dot(weighted) < kCommonGate)) return agrees;
  for (std::size_t j = 0; j < agrees.size(); ++j) {
    const Eigen::Index row = rowOf(j);
    const Eigen::Matrix3d cross = S.block<3, 3>(row, column);
    const Eigen::Vector3d left = innovation.segment<3>(row) - cross * weighted;
    const Eigen::Matrix3d covariance =
        S.block<3, 3>(row, row) - cross * solvePositive(own, Eigen::Matrix3d(cross.transpose()));
    agrees[j] = j == h || squaredMahalanobis(left, covariance) < kGate;
  }
  return agrees;
}

} // namespace

TwinFusion fuseTwins(State& state, const std::vector<Twin>& twins, std::size_t least, double sigma) {
  TwinFusion result;
  result.fused.assign(twins.size(), false);
  if (twins.empty()) return result;
  // m_now = m_before, and both turn alike: e_now - e_before = m^_before - m^_now.
  const Eigen::Index rows = rowOf(twins.size());
  const auto P = state.covariance();
  PooledMatrix PHt(state.size(), rows), S(rows, rows);
  Pooled<Eigen::VectorXd> innovation(rows, 1);
  for (std::size_t i = 0; i < twins.size(); ++i) {
    PHt.middleCols<3>(rowOf(i)) =
        P.middleCols<3>(State::offsetOf(twins[i].now)) - P.middleCols<3>(State::offsetOf(twins[i].before));
    innovation.segment<3>(rowOf(i)) =
        state.landmarks()[twins[i].before].position - state.landmarks()[twins[i].now].position;
  }
  for (std::size_t i = 0; i < twins.size(); ++i) {
    S.middleRows<3>(rowOf(i)) = PHt.middleRows<3>(State::offsetOf(twins[i].now)) -
                                PHt.middleRows<3>(State::offsetOf(twins[i].before));
  }
  S = 0.5 * (S + S.transpose());
  S.diagonal().array() += sigma * sigma;

  PooledVector<bool> best(twins.size(), false);
  std::ptrdiff_t most = 0;
  for (std::size_t h = 0; h < twins.size(); ++h) {
    PooledVector<bool> agrees = agreeing(S, innovation, h);
    const std::ptrdiff_t count = std::count(agrees.begin(), agrees.end(), true);
    if (count <= most) continue;
    most = count;
    best.swap(agrees);
  }
  if (most == 0 || static_cast<std::size_t>(most) < least) return result;

  SparseRows H(3 * most);
  Eigen::Index row = 0;
  for (std::size_t i = 0; i < twins.size(); ++i) {
    if (!best[i]) continue;
    H.add(row, State::offsetOf(twins[i].now), Eigen::Matrix3d::Identity());
    H.add(row, State::offsetOf(twins[i].before), -Eigen::Matrix3d::Identity());
    row += 3;
  }
  keepChosen(best, PHt, S, innovation);
  Correction correction(std::move(PHt), std::move(S), std::move(innovation), std::move(H));
  if (!correction.isValid() || !(correction.nis() <= kJointGate * 3.0 * static_cast<double>(most)))
    return result;
  result.nis = correction.nis();
  // Straight coordinates: a correction that moves all rigidly must not bend what lies before the camera.
  if (!state.apply(std::move(correction))) return result;
  result.fused = std::move(best);
  result.dof = 3 * static_cast<std::size_t>(most);
  return result;
}

} // namespace vi_ekf_slam::invariant
