#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <variant>
#include <vector>

#include "vi_ekf_slam/core/invariant/sparse_rows.hpp"

namespace vi_ekf_slam::invariant {

/// What happened to the error vector x of the active state (see State), as what does not take part needs to
/// know it: x moves linearly, and an update tells something about all that x is correlated with. Noise that
/// is added to x is not listed: it is correlated with nothing else.
///
/// x += G dnu.
struct Propagation {
  Eigen::Matrix<double, Eigen::Dynamic, 6> G;
};

/// Kalman update: x -= K H x with K H = A L^-1 H, for S = L L^T, A = P H^T L^-T and w = L^-1 innovation.
struct KalmanUpdate {
  Eigen::MatrixXd A;
  Eigen::MatrixXd L; ///< the lower triangle
  SparseRows H;
  Eigen::VectorXd w;
};

/// Landmark by landmark e_j - xi_p <- M_j (e_j - xi_p).
struct Transport {
  std::vector<Eigen::Matrix3d> M;
};

/// One landmark more, last: its e is xi_p and noise.
struct Birth {};

/// A landmark's three rows are gone, the last three take their place.
struct Removal {
  Eigen::Index row;
  std::uint64_t departure = 0; ///< number of the departure by which the landmark went on being held; 0: it did not
};

/// Three rows are unknown again: correlated with nothing.
struct Oblivion {
  Eigen::Index row;
};

using DeferredStep = std::variant<Propagation, KalmanUpdate, Transport, Birth, Removal, Oblivion>;

/// How much memory the step holds.
std::size_t bytesOf(const DeferredStep& step);

/// Linear functionals of x at one time, and what is learned after that time about errors x was correlated with, swept
/// backward step by step. For an error d with cross-covariance c = cov(x, d) at that time, later updates make
///
///   cov(rows . x_end, d) = rows c,   var(d) -= c^T information c,   mean(d) += c^T correction,
///
/// the compressed filter (Guivant and Nebot, "Optimization of the simultaneous localization and map-building
/// algorithm for real-time implementation", 2001) in the form of the modified Bryson-Frazier smoother (Bierman,
/// "Fixed interval smoothing with discrete measurements", 1973).
class BackwardSweep {
 public:

  /// Begins at the end of time with x of `size`, with room for `capacity` >= every size on the way.
  BackwardSweep(Eigen::Index size, Eigen::Index capacity, bool with_information);

  /// x_end itself as the first functionals.
  void startRows();
  void appendRows(const Eigen::MatrixXd& rows);

  /// To the time before `step`.
  void back(const DeferredStep& step);

  Eigen::Index size() const { return size_; }
  auto rows() const { return rows_.topLeftCorner(row_count_, size_); }
  auto information() const { return information_.topLeftCorner(size_, size_); }
  auto correction() const { return correction_.head(size_); }

 private:
  void back(const Propagation& step);
  void back(const KalmanUpdate& step);
  void back(const Transport& step);
  void back(const Birth& step);
  void back(const Removal& step);
  void back(const Oblivion& step);
  auto activeRows() { return rows_.topLeftCorner(row_count_, size_); }
  auto activeInformation() { return information_.topLeftCorner(size_, size_); }

  Eigen::Index size_;
  bool with_information_;
  Eigen::Index row_count_ = 0;
  Eigen::MatrixXd rows_;        // at least row_count_ x capacity
  Eigen::MatrixXd information_; // capacity x capacity
  Eigen::VectorXd correction_;  // capacity
};

} // namespace vi_ekf_slam::invariant
