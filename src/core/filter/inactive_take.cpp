// How inactive variables become active again, while what is deferred for the others stays so.

#include <algorithm>
#include <stdexcept>
#include <string>
#include <unordered_set>
#include <utility>

#include "vi_ekf_slam/core/filter/inactive_store.hpp"

namespace vi_ekf_slam {
namespace inactive {

/// Of those that left in a part: the variables by number, and their rows in it.
struct Division {
  std::vector<std::size_t> numbers; ///< of those that go
  std::vector<Eigen::Index> gone, kept, kept_first{0};

  /// The part has the variables from `begin` on.
  Division(const std::vector<InactiveVariable>& variables, std::size_t begin, std::size_t count,
           const std::unordered_set<Handle>& wanted) {
    Eigen::Index row = 0;
    for (std::size_t i = begin; i < begin + count; ++i) {
      const bool goes = wanted.count(variables[i].handle) != 0;
      if (goes) numbers.push_back(i);
      for (const Eigen::Index end = row + variables[i].mean.size(); row < end; ++row)
        (goes ? gone : kept).push_back(row);
      if (!goes) kept_first.push_back(static_cast<Eigen::Index>(kept.size()));
    }
  }
};

namespace {

/// The errors that a part gets at its end: those that are carried through it, then those that go. In terms of
/// its first ones ((m + t) x n0), and their covariance with those that stay ((m + t) x k).
struct Added {
  Eigen::MatrixXd origin, cross;
};

/// Of a part whose d are `origin` in terms of its first errors, of covariance `own`; `cross` (n x t) is that
/// of the active errors with those that go. Those that are carried pass it, and the ones that go join them.
template <class Pass>
Added addedBy(Carried& carried, const Division& division, const Eigen::MatrixXd& origin,
              const Eigen::MatrixXd& own, const Eigen::MatrixXd& cross, const Pass& pass) {
  const Eigen::Index n0 = origin.cols(), m = carried.rows(), t = cross.cols();
  const Eigen::MatrixXd of_gone = rowsOf(origin, division.gone), own_gone = rowsOf(own, division.gone);
  Added added{Eigen::MatrixXd(m + t, n0), Eigen::MatrixXd(m + t, own.cols() - t)};
  added.origin.bottomRows(t) = of_gone;
  added.cross.bottomRows(t) = columnsOf(own_gone, division.kept);
  Eigen::MatrixXd with_carried(t, m);
  if (m > 0) {
    const Eigen::MatrixXd C = carried.cross.topRows(n0);
    added.cross.topRows(m).noalias() = (rowsOf(origin, division.kept) * C).transpose();
    with_carried.noalias() = of_gone * C;
    added.origin.topRows(m) = -pass(carried).transpose();
  }
  carried.join(cross, with_carried, columnsOf(own_gone, division.gone));
  return added;
}

/// The block with those that are carried among its first errors, and those that go among its last.
Block extended(Block block, Carried& carried, const Division& division) {
  const Eigen::Index m = carried.rows();
  Added added = addedBy(carried, division, *block.origin, *block.own, block.cross.columns(division.gone),
                        [&block](Carried& passing) { return block.pass(passing); });
  if (!division.gone.empty()) {
    StackedRows of_kept;
    of_kept.push(columnsOf(block.cross.all(), division.kept));
    block.cross = std::move(of_kept);
    block.first = division.kept_first;
    block.origin = std::make_shared<const Eigen::MatrixXd>(rowsOf(*block.origin, division.kept));
    block.own =
        std::make_shared<const Eigen::MatrixXd>(columnsOf(rowsOf(*block.own, division.kept), division.kept));
  }
  for (Eigen::Index i = 0; i < m; ++i) block.through.push_back(block.added.rows() + i);
  block.added.push(std::move(added.origin));
  block.cross.push(std::move(added.cross));
  return block;
}

} // namespace
} // namespace inactive

/// Through the open block. Omega C (n0 x m).
Eigen::MatrixXd InactiveStore::passOpen(inactive::Carried& carried) const {
  const Eigen::Index n = open_.begin;
  const auto Omega = open_.information.topLeftCorner(n, n).selfadjointView<Eigen::Lower>();
  Eigen::MatrixXd learned = carried.learn(carried.cross, Omega, open_.correction.head(n));
  carried.cross = (open_.F.topLeftCorner(rows_, n) * carried.cross).eval();
  return learned;
}

/// As inactive::extended, of the block under way.
void InactiveStore::takeInOpen(inactive::Carried& carried, const inactive::Division& division) {
  using inactive::columnsOf, inactive::rowsOf;
  const auto &gone = division.gone, &kept = division.kept;
  const auto t = static_cast<Eigen::Index>(gone.size()), k = static_cast<Eigen::Index>(kept.size());
  const Eigen::Index n0 = open_.begin, n = rows_, left = open_.left(), m = carried.rows(), n1 = n0 + m;
  const Eigen::MatrixXd cross = open_.F.block(0, n0, n, left);
  const Eigen::MatrixXd learned_here = open_.information.block(n0, 0, left, n0);
  const Eigen::MatrixXd learned_own = open_.information.block(n0, n0, left, left);
  const Eigen::VectorXd moved = open_.correction.segment(n0, left);
  const inactive::Added added =
      inactive::addedBy(carried, division, originNow(), ownNow(), columnsOf(cross, gone),
                        [this](inactive::Carried& passing) { return passOpen(passing); });
  inactive::grow(open_.F, n + m + t, n1 + k);
  auto F = open_.F.topLeftCorner(n + m + t, n1 + k);
  F.middleCols(n0, m).setZero();
  F.block(n, n0, m, m).setIdentity();
  F.topRightCorner(n, k) = columnsOf(cross, kept);
  F.bottomLeftCorner(m + t, n0) = added.origin;
  F.bottomRightCorner(m + t, k) = added.cross;
  inactive::grow(open_.information, n1 + k, n1 + k);
  auto information = open_.information.topLeftCorner(n1 + k, n1 + k);
  information.bottomRows(m + k).setZero();
  information.bottomLeftCorner(k, n0) = rowsOf(learned_here, kept);
  information.bottomRightCorner(k, k) = columnsOf(rowsOf(learned_own, kept), kept);
  open_.correction.conservativeResize(n1 + k);
  open_.correction.segment(n0, m).setZero();
  open_.correction.tail(k) = rowsOf(moved, kept);
  Eigen::MatrixXd origin_kept = Eigen::MatrixXd::Zero(k, n1);
  origin_kept.leftCols(n0) = rowsOf(open_.origin, kept);
  open_.origin.swap(origin_kept);
  open_.own = columnsOf(rowsOf(open_.own, kept), kept);
  open_.first = division.kept_first;
  open_.begin = n1;
  rows_ += m + t;
  carried.moved.tail(t) = rowsOf(moved, gone);
}

InactiveStore::Taken InactiveStore::take(const std::vector<Handle>& handles) {
  for (const Handle handle : handles) {
    if (!contains(handle)) throw std::out_of_range("variable " + std::to_string(handle) + " is not inactive");
  }
  const std::unordered_set<Handle> wanted(handles.begin(), handles.end());
  std::vector<std::size_t> numbers;
  inactive::Carried carried;
  const auto divide = [&](std::size_t begin, std::size_t count) {
    inactive::Division division(variables_, begin, count, wanted);
    numbers.insert(numbers.end(), division.numbers.begin(), division.numbers.end());
    return division;
  };

  std::size_t next = settled_->count();
  if (const inactive::Division division = divide(0, next); !division.gone.empty()) {
    Eigen::MatrixXd rows = inactive::rowsOf(settled_->covariance, division.gone);
    carried.join(cross_.columns(division.gone), Eigen::MatrixXd(rows.rows(), 0),
                 inactive::columnsOf(rows, division.gone));
    cross_.push(std::move(rows));
  }
  for (auto& block : blocks_) {
    const inactive::Division division = divide(next, block->count());
    next += block->count();
    if (carried.rows() > 0 || !division.gone.empty())
      block = std::make_shared<const Block>(inactive::extended(*block, carried, division));
  }
  takeInOpen(carried, divide(next, open_.count()));

  Taken taken{{}, std::move(carried.own), std::move(carried.cross)};
  Eigen::Index row = 0;
  for (const std::size_t i : numbers) {
    taken.variables.push_back(variables_[i]);
    SmallVector& mean = taken.variables.back().mean;
    mean += carried.moved.segment(row, mean.size());
    row += mean.size();
    const auto gone = serials_.find(std::exchange(variables_[i].handle, kTaken));
    if (settling_.valid() && gone->second <= begun_.last_serial) begun_.taken.push_back(gone->first);
    serials_.erase(gone);
  }
  // Those that were settled leave their place there.
  const auto behind = variables_.begin() + static_cast<std::ptrdiff_t>(settled_->count());
  variables_.erase(
      std::remove_if(behind, variables_.end(), [](const InactiveVariable& v) { return v.handle == kTaken; }),
      variables_.end());
  release();
  return taken;
}

} // namespace vi_ekf_slam
