#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <variant>

#include "vi_ekf_slam/core/invariant/kept_matrix.hpp"
#include "vi_ekf_slam/core/invariant/sparse_rows.hpp"

namespace vi_ekf_slam::invariant {

/// What happened to the error vector x of the active state (see State), as what does not take part needs to
/// know it: x moves linearly, and an update tells something about all that x is correlated with. Noise that
/// is added to x is not listed: it is correlated with nothing else.
///
/// x += G dnu.
struct Propagation {
  Pooled<Eigen::Matrix<double, Eigen::Dynamic, 6>> G;
};

/// Kalman update x -= K H x, for the innovation nu of covariance S.
struct KalmanUpdate {
  KeptMatrix Kt; ///< K^T
  SparseRows H;
  Pooled<Eigen::VectorXd> y; ///< S^-1 nu
  PooledMatrix S_inverse;    ///< empty: it is R^-1 (I - H K), for R of equal 3x3 blocks
  Eigen::Matrix3d R_inverse; ///< the block's inverse
};

/// Landmark by landmark e_j - xi_p <- M_j (e_j - xi_p).
struct Transport {
  PooledVector<Eigen::Matrix3d> M;
};

/// One landmark more, last: its e is xi_p and noise.
struct Birth {};

/// A landmark's three rows are gone, the last three take their place.
struct Removal {
  Eigen::Index row;
  std::uint64_t departure =
      0; ///< number of the departure by which the landmark went on being held; 0: it did not
};

/// Three rows are unknown again: correlated with nothing.
struct Oblivion {
  Eigen::Index row;
};

using DeferredStep = std::variant<Propagation, KalmanUpdate, Transport, Birth, Removal, Oblivion>;

/// How much memory the step holds.
std::size_t bytesOf(const DeferredStep& step);

/// What is learned by a stretch of time about errors d that do not change during it, swept backward step by
/// step: with the cross-covariance c = cov(x, d) at the time reached, mean(d) += c^T correction by its end
/// (the modified Bryson-Frazier smoother; Bierman, "Fixed interval smoothing with discrete measurements",
/// 1973).
class CorrectionSweep {
 public:
  /// Begins at the end, with x of `size`.
  explicit CorrectionSweep(Eigen::Index size) : size_(size), correction_(Eigen::VectorXd::Zero(size)) {}

  /// To the time before `step`.
  void back(const DeferredStep& step);
  /// To the beginning of a stretch that takes x to F x (and noise), and has taught `learned` (see
  /// ForwardSweep).
  void back(const Eigen::Ref<const Eigen::MatrixXd>& F, const Pooled<Eigen::VectorXd>& learned);

  auto correction() const { return correction_.head(size_); }

 private:
  void back(const Propagation& step);
  void back(const KalmanUpdate& step);
  void back(const Transport& step);
  void back(const Birth& step);
  void back(const Removal& step);
  void back(const Oblivion& step);
  auto active() { return correction_.head(size_); }

  Eigen::Index size_;
  Pooled<Eigen::VectorXd> correction_; ///< its head is in use
};

/// As CorrectionSweep, how much surer the errors d have become by the end of the stretch: var(d) -= c^T
/// information c, with c = cov(x, d) at the time reached (the same smoother's covariance).
class InformationSweep {
 public:
  /// Begins at the end, with x of `size`.
  explicit InformationSweep(Eigen::Index size)
      : size_(size), information_(Eigen::MatrixXd::Zero(size, size)) {}

  /// To the time before `step`.
  void back(const DeferredStep& step);
  /// To the beginning of a stretch that takes x to F x (and noise), and has taught `information` of its own.
  void back(const Eigen::Ref<const Eigen::MatrixXd>& F, const Eigen::Ref<const Eigen::MatrixXd>& information);

  /// Symmetric, of x at the time reached.
  auto information() const { return information_.topLeftCorner(size_, size_); }

 private:
  void back(const Propagation& step);
  void back(const KalmanUpdate& step);
  void back(const Transport& step);
  void back(const Birth& step);
  void back(const Removal& step);
  void back(const Oblivion& step);
  auto active() { return information_.topLeftCorner(size_, size_); }

  Eigen::Index size_;
  Eigen::MatrixXd information_; ///< the top left part is in use
};

/// Takes cross-covariances with x forward step by step, those of any errors y that do not change: X = cov(y,
/// x), and what is learned about y by the way,
///
///   cov(y, y) -= gram,   mean(y) += learned,
///
/// the auxiliary matrices of the compressed filter (Guivant and Nebot, "Optimization of the simultaneous
/// localization and map-building algorithm for real-time implementation", 2001). Rows of the identity stand
/// for any errors d at all whose covariance with x is not yet known: with c = cov(x, d) at the beginning,
/// their X is c^T times those rows.
class ForwardSweep {
 public:
  /// Begins with X the identity of `size`; with room for `rows` more rows and `columns` >= every size on the
  /// way.
  ForwardSweep(Eigen::Index size, Eigen::Index rows, Eigen::Index columns);

  /// To the time after `step`.
  void forward(const DeferredStep& step);
  /// Three errors y more, with which x has the covariance `cross` (size() x 3).
  void append(const Pooled<Eigen::Matrix<double, Eigen::Dynamic, 3>>& cross);

  Eigen::Index size() const { return columns_; }
  auto X() const { return X_.topLeftCorner(rows_, columns_); }
  /// Of rows that begin at different times: since the later one did. Of it only the lower triangle is valid.
  auto gram() const { return gram_.topLeftCorner(rows_, rows_); }
  auto learned() const { return learned_.head(rows_); }

 private:
  void forward(const Propagation& step);
  void forward(const KalmanUpdate& step);
  void forward(const Transport& step);
  void forward(const Birth& step);
  void forward(const Removal& step);
  void forward(const Oblivion& step);
  auto active() { return X_.topLeftCorner(rows_, columns_); }

  Eigen::Index rows_, columns_;
  PooledMatrix X_, gram_;
  Pooled<Eigen::VectorXd> learned_;
};

} // namespace vi_ekf_slam::invariant
