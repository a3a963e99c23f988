#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <future>
#include <memory>
#include <unordered_map>
#include <vector>

#include "vi_ekf_slam/core/filter/direct_update.hpp"
#include "vi_ekf_slam/core/filter/inactive_parts.hpp"
#include "vi_ekf_slam/core/filter/innovation.hpp"
#include "vi_ekf_slam/core/filter/variables.hpp"

namespace vi_ekf_slam {

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
/// at a time, in which some variables leave; what blocks do to older ones is deferred.
///
/// A variable that is wanted again (take) is given to all blocks since it left as one of their first errors,
/// as if it had been active: it took part in nothing there. With C, its covariance with x0,
///
///   F' = [F, 0; -C^T Omega, I],   Omega' = diag(Omega, 0),   psi' = [psi; 0].
///
/// The others need nothing of it. What is deferred for them is settled when all are wanted (settle), or by a
/// thread beside (beginSettling), so that there are few blocks.
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
  /// They were corrected by `in`, as `direct` has it where that is given, else by `root` = P H^T L^-T, and
  /// `points` re-expressed.
  void correct(const Innovation& in, const DirectUpdate* direct, const Eigen::MatrixXd& root,
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

  /// Some become the last active errors: in the order in which they left, as they are now, with the
  /// covariance of these errors d (k x k), and of the other active errors with them (n x k).
  struct Taken {
    std::vector<InactiveVariable> variables;
    Eigen::MatrixXd covariance, cross;
  };
  /// Throws std::out_of_range, and takes none, where one is not inactive.
  Taken take(const std::vector<Handle>& handles);

  /// Marginalises those that have been inactive for the longest time, `count` or a few more; the rest stays
  /// exact. Which ones.
  std::vector<Handle> marginaliseOldest(std::size_t count);

  /// Variables from elsewhere in the place of all that are held, inactive for longer than any that comes:
  /// `covariance` of their errors d (N x N) and `cross` (n x N) of the active errors with them.
  void adopt(std::vector<InactiveVariable> variables, const Eigen::MatrixXd& covariance,
             Eigen::MatrixXd cross);
  /// The means of all, in the order of estimates(), are others by so much.
  void move(const std::vector<SmallVector>& by);

  /// All that was deferred, done. The cost is about n N^2 for N rows of inactive variables.
  void settle();
  /// Does so for the blocks that have ended in a thread, while all goes on. endSettling, which waits for it,
  /// is for the caller, at a moment that does not depend on the thread; marginaliseOldest and settle do it
  /// first.
  void beginSettling();
  void endSettling();
  bool isSettling() const { return settling_.valid(); }
  /// What that would cost now, floating-point operations.
  double settlingCost() const;
  /// How many blocks wait to be settled: to take a row costs some n^2 for each.
  std::size_t deferredBlocks() const { return blocks_.size(); }

  /// All, the one that has been inactive for the longest time first, with the means of now; and, with
  /// `exact`, the covariances of now in the place of those when last settled, which are never smaller.
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

  // Of a store that has been settled since anything else:
  /// As estimates().
  const std::vector<InactiveVariable>& variables() const { return variables_; }
  Eigen::Index rowOf(std::size_t index) const { return settled_->first[index]; }
  /// Of the errors d.
  const SymmetricPanels& covariance() const { return settled_->covariance; }
  /// Of the active errors with d (n x N).
  const Eigen::MatrixXd& cross() const { return cross_.first(); }

  /// Of memory, with what a settling has replaced.
  std::size_t bytes() const;

 private:
  using Block = inactive::Block;
  using OpenBlock = inactive::OpenBlock;
  using Blocks = std::deque<std::shared_ptr<const Block>>;
  /// The pose's handle, which is never inactive: of a place among the settled ones that is empty.
  static constexpr Handle kTaken = 0;

  Eigen::Ref<Eigen::MatrixXd> map() { return open_.F.topLeftCorner(rows_, columns()); }
  Eigen::Index columns() const { return open_.begin + open_.left(); }
  Estimate estimateInOpen(std::size_t i) const;
  void begin(Eigen::Index rows);
  void close();
  Block closed() const;
  /// Of those that left in the open block, as they are now: d in terms of x0, and its covariance.
  Eigen::MatrixXd originNow() const;
  Eigen::MatrixXd ownNow() const;
  Eigen::MatrixXd passOpen(inactive::Carried& carried) const;
  void takeInOpen(inactive::Carried& carried, const inactive::Division& division);
  /// What is being settled: the first `blocks` and what was settled, with these variables. Those that left
  /// have a serial up to `last_serial`, unless they came back, as the ones of `taken` did, in that order.
  struct Begun {
    std::size_t blocks = 0;
    std::vector<Handle> handles, taken;
    std::uint64_t last_serial = 0;
  };
  /// What a settling has replaced, until the next one.
  struct Replaced {
    std::shared_ptr<inactive::Settled> settled;
    inactive::StackedRows cross;
    Blocks blocks;
  };
  Begun begun() const;
  void accept(const inactive::Composed& composed, const Begun& begun);
  inactive::Settled takeSettled();
  std::vector<std::size_t> keptOfSettled() const;
  void release();

  std::vector<InactiveVariable> variables_; ///< the settled ones, block by block, those of the open one
  std::shared_ptr<inactive::Settled> settled_ = std::make_shared<inactive::Settled>(); ///< shared by copies
  inactive::StackedRows cross_; ///< of the first block's first errors with the settled
  Blocks blocks_;               ///< closed ones, the first one first
  OpenBlock open_;
  Eigen::Index rows_ = 0;       ///< n, of the active errors now
  Eigen::Index began_with_ = 0; ///< n, when the open block began
  double surplus_ = 0.0;        ///< of columns over that, as shares of it, summed over the updates since
  std::unordered_map<Handle, std::uint64_t> serials_;
  std::uint64_t last_serial_ = 0;
  std::shared_future<inactive::Composed> settling_;
  Begun begun_;       ///< where that is under way
  Replaced replaced_; ///< by the one before
};

} // namespace vi_ekf_slam
