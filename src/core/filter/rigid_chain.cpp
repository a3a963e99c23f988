#include "vi_ekf_slam/core/filter/rigid_chain.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kPiece = 8;  // points, enough for a turn and few enough to be close together
constexpr double kLongestTurn = 1; // rad; more between two pieces is no turn

/// Some points that follow each other.
struct Piece {
  std::size_t begin, end;
  Eigen::Vector3d centre, correction; ///< means
  Eigen::Vector3d turn;               ///< rad
};

Eigen::Vector3d meanOf(const std::vector<Eigen::Vector3d>& v, std::size_t begin, std::size_t end) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::size_t i = begin; i < end; ++i) sum += v[i];
  return sum / static_cast<double>(end - begin);
}

/// The turn w of least squares: correction - mean correction = w x (point - centre).
Piece pieceOf(const std::vector<Eigen::Vector3d>& points, const std::vector<Eigen::Vector3d>& corrections,
              std::size_t begin, std::size_t end) {
  Piece piece{begin, end, meanOf(points, begin, end), meanOf(corrections, begin, end),
              Eigen::Vector3d::Zero()};
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (std::size_t i = begin; i < end; ++i) {
    const Eigen::Vector3d arm = points[i] - piece.centre;
    A -= so3::hat(arm) * so3::hat(arm);
    b += arm.cross(corrections[i] - piece.correction);
  }
  A.diagonal().array() += 1e-6 * A.trace() + 1e-12; // points in a line say nothing about a turn around it
  piece.turn = A.ldlt().solve(b);
  return piece;
}

/// `way` after `change`, as far as that turns it; the rest along the turned way.
Eigen::Vector3d turned(const Eigen::Vector3d& way, const Eigen::Vector3d& change) {
  const Eigen::Vector3d turn = way.cross(change) / std::max(way.squaredNorm(), 1e-12);
  if (turn.norm() > kLongestTurn) return way + change;
  return so3::Exp(turn) * (way + change - turn.cross(way));
}

} // namespace

std::vector<Eigen::Vector3d> moveAsChain(const std::vector<Eigen::Vector3d>& points,
                                         const std::vector<Eigen::Vector3d>& corrections) {
  std::vector<Eigen::Vector3d> moved(points.size());
  Eigen::Vector3d centre = Eigen::Vector3d::Zero(), last_centre = centre, last_correction = centre;
  for (std::size_t begin = 0; begin < points.size();) {
    const std::size_t left = points.size() - begin;
    const Piece piece = pieceOf(points, corrections, begin, begin + (left < 2 * kPiece ? left : kPiece));
    centre = begin == 0 ? Eigen::Vector3d(piece.centre + so3::leftJacobian(piece.turn) * piece.correction)
                        : Eigen::Vector3d(centre + turned(piece.centre - last_centre,
                                                          piece.correction - last_correction));
    last_centre = piece.centre;
    last_correction = piece.correction;
    const Eigen::Matrix3d R = so3::Exp(piece.turn);
    for (std::size_t i = begin; i < piece.end; ++i) {
      const Eigen::Vector3d arm = points[i] - piece.centre;
      moved[i] = centre + R * (arm + corrections[i] - piece.correction - piece.turn.cross(arm));
    }
    begin = piece.end;
  }
  return moved;
}

} // namespace vi_ekf_slam
