// How inactive variables become active again, while what is deferred for the others stays so.

#include <algorithm>
#include <stdexcept>
#include <string>
#include <unordered_set>
#include <utility>

#include "vi_ekf_slam/core/filter/inactive_store.hpp"

namespace vi_ekf_slam {
namespace inactive {
namespace {

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

/// (rows of M) by (columns + m), zeros behind.
Eigen::MatrixXd padded(const Eigen::MatrixXd& M, Eigen::Index m) {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(M.rows(), M.cols() + m);
  result.leftCols(M.cols()) = M;
  return result;
}

/// The block with those that are carried among its first errors, and those that go among its last. They are
/// carried to its end, and the ones that go are from there on.
Block extended(const Block& block, Carried& carried, const Division& division) {
  const Eigen::Index n0 = block.begin, n = block.F.rows(), m = carried.rows();
  const auto t = static_cast<Eigen::Index>(division.gone.size());
  const auto k = static_cast<Eigen::Index>(division.kept.size());
  const Eigen::MatrixXd cross = columnsOf(block.F.rightCols(block.left()), division.gone);
  const Eigen::MatrixXd origin = rowsOf(block.origin, division.gone);
  const Eigen::MatrixXd own = rowsOf(block.own, division.gone);
  Block result;
  result.begin = n0 + m;
  result.first = division.kept_first;
  result.origin = padded(rowsOf(block.origin, division.kept), m);
  result.own = columnsOf(rowsOf(block.own, division.kept), division.kept);
  result.F.setZero(n + m + t, n0 + m + k);
  result.F.topLeftCorner(n, n0) = block.F.leftCols(n0);
  result.F.topRightCorner(n, k) = columnsOf(block.F.rightCols(block.left()), division.kept);
  result.F.bottomLeftCorner(t, n0) = origin;
  result.F.bottomRightCorner(t, k) = columnsOf(own, division.kept);
  result.information.setZero(n0 + m, n0 + m);
  result.information.topLeftCorner(n0, n0) = block.information;
  result.correction.setZero(n0 + m);
  result.correction.head(n0) = block.correction;
  Eigen::MatrixXd with_carried(t, m);
  if (m > 0) {
    result.F.block(n, n0, m, m).setIdentity();
    result.F.block(n, n0 + m, m, k) = (result.origin.leftCols(n0) * carried.cross).transpose();
    with_carried.noalias() = origin * carried.cross;
    const Eigen::MatrixXd learned = carried.pass(block.F.leftCols(n0), block.information, block.correction);
    result.F.block(n, 0, m, n0) = -learned.transpose();
  }
  carried.join(cross, with_carried, columnsOf(own, division.gone));
  return result;
}

} // namespace
} // namespace inactive

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
  const inactive::Division division = divide(next, open_.count());
  const Eigen::Index m = carried.rows();
  Block result = inactive::extended(closed(), carried, division);
  // What the open block has of all its columns.
  const Eigen::Index n0 = open_.begin, n1 = result.begin, k = result.left();
  const auto information = open_.information.topLeftCorner(columns(), columns());
  const Eigen::VectorXd of_left = open_.correction.tail(open_.left());
  result.information.conservativeResize(n1 + k, n1 + k);
  result.information.bottomRows(k).setZero();
  result.information.block(n1, 0, k, n0) =
      inactive::rowsOf(information.bottomLeftCorner(open_.left(), n0), division.kept);
  result.information.bottomRightCorner(k, k) = inactive::columnsOf(
      inactive::rowsOf(information.bottomRightCorner(open_.left(), open_.left()), division.kept),
      division.kept);
  result.correction.conservativeResize(n1 + k);
  result.correction.tail(k) = inactive::rowsOf(of_left, division.kept);
  result.origin = inactive::padded(inactive::rowsOf(open_.origin, division.kept), m);
  result.own = inactive::columnsOf(inactive::rowsOf(open_.own, division.kept), division.kept);
  carried.moved.tail(static_cast<Eigen::Index>(division.gone.size())) =
      inactive::rowsOf(of_left, division.gone);
  open_ = std::move(result);

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
  rows_ += row;
  release();
  return taken;
}

} // namespace vi_ekf_slam
