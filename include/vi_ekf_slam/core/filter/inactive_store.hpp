#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <memory>
#include <unordered_map>
#include <vector>

#include "vi_ekf_slam/core/filter/direct_update.hpp"
#include "vi_ekf_slam/core/filter/innovation.hpp"
#include "vi_ekf_slam/core/filter/symmetric_panels.hpp"
#include "vi_ekf_slam/core/filter/variables.hpp"

namespace vi_ekf_slam {

/// A variable that takes part in no measurement for now.
struct InactiveVariable {
  Handle handle = 0;
  Eigen::VectorXd mean;
  Eigen::VectorXd
      linearised; ///< its mean when it was made inactive: where its error was converted, and is back
};

/// The variables that take part in no measurement, exactly in the joint covariance with the active ones and
/// with each other, at a cost per update that does not depend on how many they are: the compressed EKF
/// (Guivant and Nebot, "Optimization of the simultaneous localization and map-building algorithm for
/// real-time implementation", IEEE T-RA 17(3), 2001).
///
/// Their errors d (docs/architecture.md, "Errors") do not change while the body moves. Every change of the
/// active errors x is linear, x' = F x + noise, and every measurement H x tells about d what P_dx tells, so
/// that over a period that begins with x0
///
///   P_xd = F P_x0d,   P_dd' = P_dd - P_dx0 Omega P_x0d,   d^' = d^ + P_dx0 psi,
///
/// with F, Omega and psi of the size of x alone. They are kept up to date at once, for a block of the drive
/// at a time, in which some variables leave; what blocks do to older ones waits until these are wanted
/// (settle).
class InactiveStore {
 public:
  std::size_t size() const { return serials_.size(); }
  bool isEmpty() const { return serials_.empty(); }
  bool contains(Handle handle) const { return serials_.count(handle) != 0; }
  /// How many variables have been made inactive since this one was.
  std::uint64_t deactivatedSince(Handle handle) const { return last_serial_ - serials_.at(handle); }

  // What the active errors do, in the order in which they do it. Nothing is kept where nothing is inactive.

  /// The rows of the linear map F, to be transformed as the active errors are.
  template <class Transform>
  void transform(const Transform& transform_rows) {
    if (!isEmpty()) transform_rows(map());
  }
  /// They were corrected by `in`, as `direct` has it where that is given, and `points` re-expressed.
  void correct(const Innovation& in, const DirectUpdate* direct,
               const std::vector<Variables::Reexpressed>& points);
  /// A period of the compressed core ends (see Filter): Omega = Gamma Gamma^T and psi (`correction`) of its
  /// first c active errors. Before F's rows are transformed accordingly.
  void learn(const Eigen::Ref<const Eigen::MatrixXd>& Gamma, const Eigen::VectorXd& correction);
  /// `rows` more: a linear function of them and noise.
  void append(Eigen::Index rows, const LinearFunction& by);
  void erase(const Variables::Gone& gone);
  /// The rows [row, row + rows) know nothing of the inactive ones any more.
  void forget(Eigen::Index row, Eigen::Index rows);

  /// The variable of the active rows [row, row + k) is made inactive: d = x_row + D x_pose + noise, with D
  /// (k x 6) for the pose's errors, `own` (k x k) the covariance of d, and `cross` (n x k) that of x with d.
  /// To be erased from the active ones afterwards. Where a new block is due it begins here, if `ends_block`:
  /// with the active errors of now, which are the fewer where variables have just left.
  void add(Handle handle, const Eigen::VectorXd& mean, Eigen::Index row,
           const Eigen::Ref<const Eigen::MatrixXd>& D, const Eigen::Ref<const Eigen::MatrixXd>& own,
           const Eigen::Ref<const Eigen::MatrixXd>& cross, bool ends_block = true);

  /// All that was deferred, done. The cost is about n N^2 for N rows of inactive variables.
  void settle();
  /// What settle would cost now, floating-point operations.
  double settlingCost() const;

  // Of a settled store:
  /// All, the one that has been inactive for the longest time first.
  const std::vector<InactiveVariable>& variables() const { return settled_->variables; }
  Eigen::Index rowOf(std::size_t index) const { return settled_->first[index]; }
  Eigen::Index rows() const { return settled_->first.back(); }
  /// Of the errors d.
  const SymmetricPanels& covariance() const { return settled_->covariance; }
  /// Of the active errors with d (n x N).
  const Eigen::MatrixXd& cross() const { return settled_->cross; }
  /// Their means are others.
  void setMeans(const std::vector<Eigen::VectorXd>& means);
  /// Takes some out: they are the last active rows now, `with_others` (k x N) their covariance with all d.
  void take(const std::vector<Handle>& handles, const Eigen::MatrixXd& with_others);

  /// Marginalises those that have been inactive for the longest time, `count` or a few more; the rest stays
  /// exact. Which ones.
  std::vector<Handle> marginaliseOldest(std::size_t count);

  /// Variables from elsewhere in the place of all that are held, inactive for longer than any that comes:
  /// `covariance` of their errors d (N x N) and `cross` (n x N) of the active errors with them.
  void adopt(std::vector<InactiveVariable> variables, const Eigen::MatrixXd& covariance,
             Eigen::MatrixXd cross);

  /// All, in the order of variables(), with the means of now; and, with `exact`, the covariances of now in
  /// the place of those when last settled, which are never smaller.
  struct Estimate {
    InactiveVariable variable;
    Eigen::MatrixXd covariance;
  };
  std::vector<Estimate> estimates(bool exact) const;
  /// One of them as it is now, and the covariance of the active errors with it (n x k).
  struct Related {
    Estimate estimate;
    Eigen::MatrixXd cross;
  };
  Related related(Handle handle) const;
  std::vector<Handle> handles() const;

  std::size_t bytes() const;

 private:
  /// What a part of the drive did: variables left, and the older ones learned by way of its first errors x0.
  struct Block {
    Eigen::Index begin = 0; ///< n0, size of x0
    std::vector<InactiveVariable> variables;
    std::vector<Eigen::Index> first{0};
    Eigen::MatrixXd F;           ///< n x (n0 + k): of x0, and P_xd of those that left
    Eigen::MatrixXd information; ///< (n0 + k) square, lower triangle: sum of (H F)^T S^-1 (H F)
    Eigen::VectorXd correction;  ///< n0 + k: sum of (H F)^T S^-1 residual
    Eigen::MatrixXd origin;      ///< k x n0: d in terms of x0, when it left
    Eigen::MatrixXd own;         ///< k x k, lower triangle: covariance of d when they left
    Eigen::Index left() const { return first.back(); }
  };
  struct Settled {
    std::vector<InactiveVariable> variables;
    std::vector<Eigen::Index> first{0};
    SymmetricPanels covariance;
    Eigen::MatrixXd cross;
  };

  Eigen::Ref<Eigen::MatrixXd> map() { return open_.F.topLeftCorner(rows_, columns()); }
  Eigen::Index columns() const { return open_.begin + open_.left(); }
  Estimate estimateInOpen(std::size_t i) const;
  void begin(Eigen::Index rows);
  void close();
  Settled& ownSettled();
  void drop(const std::vector<Handle>& handles);
  void release();

  std::shared_ptr<Settled> settled_ = std::make_shared<Settled>(); ///< copied before a change while shared
  std::deque<std::shared_ptr<const Block>> blocks_;                ///< closed ones, the first one first
  Block open_;
  Eigen::Index rows_ = 0; ///< n, of the active errors now
  std::unordered_map<Handle, std::uint64_t> serials_;
  std::uint64_t last_serial_ = 0;
};

} // namespace vi_ekf_slam
