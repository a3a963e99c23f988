// What InactiveStore says of its variables without settling them.

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/filter/inactive_store.hpp"
#include "vi_ekf_slam/core/filter/symmetric.hpp"

namespace vi_ekf_slam {
namespace {

/// Of those of a part: `own` and `cross` are their covariance, and that of the active errors with them, at
/// its end.
template <class Own>
void estimatePart(const inactive::Since& since, const inactive::Departed& part, const Own& own,
                  const inactive::StackedRows& cross, const InactiveVariable* variables,
                  InactiveStore::Estimate* result) {
  constexpr std::size_t kAtATime = 64;
  const bool exact = since.information.size() > 0;
  for (std::size_t begin = 0; begin < part.count(); begin += kAtATime) {
    const std::size_t end = std::min(part.count(), begin + kAtATime);
    const Eigen::MatrixXd C = cross.middleCols(part.first[begin], part.first[end] - part.first[begin]);
    const Eigen::VectorXd moved = C.transpose() * since.correction;
    Eigen::MatrixXd learned;
    if (exact) learned.noalias() = since.information * C;
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Index from = part.first[i], row = from - part.first[begin],
                         rows = part.first[i + 1] - from;
      result[i] = {variables[i], own.block(from, from, rows, rows)};
      result[i].variable.mean += moved.segment(row, rows);
      if (exact)
        result[i].covariance.noalias() -= C.middleCols(row, rows).transpose() * learned.middleCols(row, rows);
      mirrorLower(result[i].covariance);
    }
  }
}

} // namespace

/// Of one that has left in the open block: the block's information holds what was learned of it since.
InactiveStore::Estimate InactiveStore::estimateInOpen(std::size_t i) const {
  const Eigen::Index n = open_.begin, row = open_.first[i], rows = open_.first[i + 1] - row;
  Estimate estimate{variables_[variables_.size() - open_.count() + i], open_.own.block(row, row, rows, rows)};
  estimate.variable.mean += open_.correction.segment(n + row, rows);
  estimate.covariance -= open_.information.block(n + row, n + row, rows, rows);
  mirrorLower(estimate.covariance);
  return estimate;
}

std::vector<InactiveStore::Estimate> InactiveStore::estimates(bool exact) const {
  std::vector<Estimate> result(variables_.size());
  std::size_t next = variables_.size() - open_.count();
  for (std::size_t i = 0; i < open_.count(); ++i) result[next + i] = estimateInOpen(i);
  if (next == 0) return result;
  const Eigen::Index n = open_.begin;
  inactive::Since since{{}, open_.correction.head(n)};
  if (exact) {
    since.information = open_.information.topLeftCorner(n, n);
    mirrorLower(since.information);
  }
  for (auto b = blocks_.rbegin(); b != blocks_.rend(); ++b) {
    const Block& block = **b;
    next -= block.count();
    estimatePart(since, block, *block.own, block.cross, &variables_[next], &result[next]);
    since.goBack(block);
  }
  estimatePart(since, *settled_, settled_->covariance, cross_, variables_.data(), result.data());
  result.erase(std::remove_if(result.begin(), result.end(),
                              [](const Estimate& e) { return e.variable.handle == kTaken; }),
               result.end());
  return result;
}

InactiveStore::Related InactiveStore::related(Handle handle) const {
  const auto found = std::find_if(variables_.begin(), variables_.end(),
                                  [handle](const InactiveVariable& v) { return v.handle == handle; });
  if (found == variables_.end() || handle == kTaken)
    throw std::out_of_range("variable " + std::to_string(handle) + " is not inactive");
  const auto i = static_cast<std::size_t>(found - variables_.begin());
  const Eigen::Index rows = found->mean.size();
  if (const std::size_t closed = variables_.size() - open_.count(); i >= closed)
    return {estimateInOpen(i - closed), open_.F.block(0, open_.begin + open_.first[i - closed], rows_, rows)};
  Estimate estimate{*found, {}};
  inactive::Carried carried;
  std::size_t begin = 0; // of a part
  const auto joinIfOf = [&](const inactive::Departed& part, const auto& own, const auto& cross) {
    if (begin <= i && i < begin + part.count()) {
      const Eigen::Index row = part.first[i - begin];
      carried.join(cross.middleCols(row, rows), Eigen::MatrixXd(rows, 0), own.block(row, row, rows, rows));
    }
    begin += part.count();
  };
  joinIfOf(*settled_, settled_->covariance, cross_);
  for (const auto& block : blocks_) {
    if (carried.rows() > 0) block->pass(carried);
    joinIfOf(*block, *block->own, block->cross);
  }
  passOpen(carried);
  estimate.variable.mean += carried.moved;
  estimate.covariance = std::move(carried.own);
  mirrorLower(estimate.covariance);
  return {std::move(estimate), std::move(carried.cross)};
}

std::vector<Handle> InactiveStore::handles() const {
  std::vector<Handle> result;
  for (const auto& [handle, serial] : serials_) result.push_back(handle);
  return result;
}

std::size_t InactiveStore::bytes() const {
  const Eigen::Index open =
      open_.F.size() + open_.information.size() + open_.origin.size() + open_.own.size();
  std::size_t total = settled_->covariance.bytes() + cross_.bytes();
  if (replaced_.settled) total += replaced_.settled->covariance.bytes() + replaced_.cross.bytes();
  for (const Blocks* blocks : {&blocks_, &replaced_.blocks}) {
    for (const auto& block : *blocks) total += block->bytes();
  }
  return total + static_cast<std::size_t>(open) * sizeof(double);
}

} // namespace vi_ekf_slam
