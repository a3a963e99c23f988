#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <memory>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/filter/linear_measurement.hpp"
#include "vi_ekf_slam/core/filter/symmetric_panels.hpp"
#include "vi_ekf_slam/core/filter/variables.hpp"

namespace vi_ekf_slam {

/// A variable that takes part in no measurement for now, of at most six rows.
struct InactiveVariable {
  Handle handle = 0;
  SmallVector mean;
  SmallVector linearised; ///< its mean when it was made inactive: where its error was converted, and is back
};

/// Of what InactiveStore is made. Variables are in the order in which they left.
namespace inactive {

/// Some that left, one behind the other: where the rows of each begin, and how many there are.
struct Departed {
  std::vector<Eigen::Index> first{0};
  Eigen::Index left() const { return first.back(); }
  std::size_t count() const { return first.size() - 1; }
};

/// Those for which nothing is deferred from before the first block.
struct Settled : Departed {
  SymmetricPanels covariance;
};

/// A matrix that gets rows at its end. Those that it has are not copied then, and shared by its copies.
class StackedRows {
 public:
  void push(Eigen::MatrixXd rows) {
    parts_.push_back(std::make_shared<const Eigen::MatrixXd>(std::move(rows)));
  }
  /// (rows x count)
  Eigen::MatrixXd middleCols(Eigen::Index column, Eigen::Index count) const;
  Eigen::Index rows() const;
  /// Times R, of few columns.
  Eigen::MatrixXd operator*(const Eigen::Ref<const Eigen::MatrixXd>& R) const;
  /// Those in the list.
  Eigen::MatrixXd columns(const std::vector<Eigen::Index>& list) const;
  Eigen::MatrixXd all() const {
    return parts_.empty() ? Eigen::MatrixXd() : middleCols(0, parts_[0]->cols());
  }
  /// Where nothing was added.
  const Eigen::MatrixXd& first() const { return *parts_.front(); }
  std::size_t bytes() const;

 private:
  std::vector<std::shared_ptr<const Eigen::MatrixXd>> parts_;
};

/// Inactive variables on their way through the blocks: at the end of one, their covariance with the active
/// errors (n x m), and with each other (m x m), and by how much their means have changed.
struct Carried {
  Eigen::MatrixXd cross, own;
  Eigen::VectorXd moved;

  Eigen::Index rows() const { return cross.cols(); }
  /// By Omega and psi of a block, of whose x0 they have the covariance C (n0 x m). Omega C.
  template <class Information, class Correction>
  Eigen::MatrixXd learn(const Eigen::Ref<const Eigen::MatrixXd>& C, const Information& Omega,
                        const Correction& psi) {
    Eigen::MatrixXd learned = Omega * C;
    moved.noalias() += C.transpose() * psi;
    own.noalias() -= C.transpose() * learned;
    return learned;
  }
  /// More, of which `with_others` (k x m) is the covariance with those that there are.
  void join(const Eigen::MatrixXd& more_cross, const Eigen::MatrixXd& with_others,
            const Eigen::MatrixXd& more_own);
};

/// What a part of the drive did that has ended: some variables left, and older ones learned by way of its
/// first errors. Those are x0, of n0 rows, and `through`, which were taken back since and were carried
/// through it; the errors at its end are x, of n rows, and `added`: they and the ones that left in it and
/// were taken back, in the order of taking. What does not change when more are taken is shared by copies.
struct Block : Departed {
  struct Passage {
    Eigen::MatrixXd F;           ///< n x n0: x in terms of x0
    Eigen::MatrixXd information; ///< n0 square: Omega, sum of (H F)^T S^-1 (H F)
    Eigen::VectorXd correction;  ///< n0: psi, sum of (H F)^T S^-1 residual
  };
  std::shared_ptr<const Passage> passage;
  StackedRows added;                 ///< a x n0: in terms of x0, but for themselves
  std::vector<Eigen::Index> through; ///< which rows of those are first errors too

  StackedRows cross;                             ///< (n + a) x k: P_xd of those that left, at the end
  std::shared_ptr<const Eigen::MatrixXd> origin; ///< k x n0: d in terms of x0, at the end
  std::shared_ptr<const Eigen::MatrixXd> own;    ///< k x k: covariance of d at the end

  Eigen::Index atBegin() const { return passage->F.cols() + static_cast<Eigen::Index>(through.size()); }
  Eigen::Index atEnd() const { return passage->F.rows() + added.rows(); }
  /// A (r x atEnd) in terms of the first errors (r x atBegin).
  Eigen::MatrixXd back(const Eigen::Ref<const Eigen::MatrixXd>& A) const;
  /// Through it. Omega C of x0 (n0 x m).
  Eigen::MatrixXd pass(Carried& carried) const;
  std::size_t bytes() const;
};

/// What has happened since the end of a block to those that left in it or before: Omega and psi.
struct Since {
  Eigen::MatrixXd information; ///< empty: it is not asked for
  Eigen::VectorXd correction;
  /// From the end of a block to its beginning.
  void goBack(const Block& block);
};

/// The block under way. Its information (lower triangle) and correction are those of all its columns, origin
/// and own of when each left.
struct OpenBlock : Departed {
  Eigen::Index begin = 0; ///< n0, size of x0
  Eigen::MatrixXd F;      ///< n x (n0 + k): x in terms of x0, and P_xd of those that left
  Eigen::MatrixXd information;
  Eigen::VectorXd correction;
  Eigen::MatrixXd origin, own;
};

/// Of those that left in a part, the ones that are taken and those that stay.
struct Division;

/// At least so large; what there is stays.
void grow(Eigen::MatrixXd& matrix, Eigen::Index rows, Eigen::Index cols);
/// The columns (rows) of M that are in the list; one of all rows has them in their order.
Eigen::MatrixXd columnsOf(const Eigen::Ref<const Eigen::MatrixXd>& M, const std::vector<Eigen::Index>& kept);
Eigen::MatrixXd rowsOf(const Eigen::Ref<const Eigen::MatrixXd>& M, const std::vector<Eigen::Index>& kept);
Eigen::MatrixXd rowsOf(const SymmetricPanels& P, const std::vector<Eigen::Index>& kept);

/// All blocks' effect, done. The cost is about n N^2.
struct Composed {
  std::shared_ptr<Settled> settled;
  StackedRows cross;     ///< with the active errors at the end of the last block
  Eigen::VectorXd moved; ///< by how much the means are others, row by row
};
/// `kept`: the variables (by number) of the settled ones that are still there.
Composed composed(Settled settled, Eigen::MatrixXd cross, const std::vector<std::size_t>& kept,
                  const std::deque<std::shared_ptr<const Block>>& blocks);

} // namespace inactive
} // namespace vi_ekf_slam
