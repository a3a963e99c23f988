#pragma once

#include <Eigen/Core>
#include <cstddef>
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

/// What a part of the drive did: some left, and older ones learned by way of its first errors x0.
struct Block {
  Eigen::Index begin = 0;             ///< n0, size of x0
  std::vector<Eigen::Index> first{0}; ///< of those that left, and how many rows there are
  Eigen::MatrixXd F;                  ///< n x (n0 + k): of x0, and P_xd of those that left, both at the end
  Eigen::MatrixXd information;        ///< n0 square: Omega, sum of (H F)^T S^-1 (H F)
  Eigen::VectorXd correction;         ///< n0: psi, sum of (H F)^T S^-1 residual
  Eigen::MatrixXd origin;             ///< k x n0: d in terms of x0, at the end
  Eigen::MatrixXd own;                ///< k x k: covariance of d at the end
  Eigen::Index left() const { return first.back(); }
  std::size_t count() const { return first.size() - 1; }
};

/// Those for which nothing is deferred from before the first block.
struct Settled {
  std::vector<Eigen::Index> first{0};
  SymmetricPanels covariance;
  Eigen::Index rows() const { return first.back(); }
  std::size_t count() const { return first.size() - 1; }
};

/// A matrix that gets rows at its end. Those that it has are not copied then, and shared by its copies.
class StackedRows {
 public:
  void push(Eigen::MatrixXd rows) {
    parts_.push_back(std::make_shared<const Eigen::MatrixXd>(std::move(rows)));
  }
  /// (rows x count)
  Eigen::MatrixXd middleCols(Eigen::Index column, Eigen::Index count) const;
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
  /// Through a block of F (of x0), Omega and psi. Omega C.
  template <class F, class Information, class Correction>
  Eigen::MatrixXd pass(const F& block_F, const Information& Omega, const Correction& psi) {
    Eigen::MatrixXd learned = Omega * cross;
    moved.noalias() += cross.transpose() * psi;
    own.noalias() -= cross.transpose() * learned;
    cross = (block_F * cross).eval();
    return learned;
  }
  /// More, of which `with_others` (k x m) is the covariance with those that there are.
  void join(const Eigen::MatrixXd& more_cross, const Eigen::MatrixXd& with_others,
            const Eigen::MatrixXd& more_own);
};

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
                  const std::vector<std::shared_ptr<const Block>>& blocks);

} // namespace inactive
} // namespace vi_ekf_slam
