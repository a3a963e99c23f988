// What InactiveStore says of its variables without settling them.

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/filter/inactive_store.hpp"
#include "vi_ekf_slam/core/filter/symmetric.hpp"

namespace vi_ekf_slam {
namespace {

/// What has happened since the end of a block to those that left in it or before: information (empty where it
/// is not asked for) and correction.
struct Since {
  Eigen::MatrixXd information;
  Eigen::VectorXd correction;

  /// Of a variable that left with covariance `own`, and `cross` with the active errors at the block's end.
  InactiveStore::Estimate estimate(const InactiveVariable& variable, Eigen::MatrixXd own,
                                   const Eigen::Ref<const Eigen::MatrixXd>& cross) const {
    InactiveStore::Estimate now{variable, std::move(own)};
    now.variable.mean += cross.transpose() * correction;
    if (information.size() > 0) now.covariance -= cross.transpose() * (information * cross).eval();
    mirrorLower(now.covariance);
    return now;
  }
  /// From the end of a block to its beginning.
  void goBack(const inactive::Block& block) {
    const auto F = block.F.leftCols(block.begin);
    correction = (block.correction + F.transpose() * correction).eval();
    if (information.size() > 0) information = (F.transpose() * information * F).eval() + block.information;
  }
};

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
  Since since{{}, open_.correction.head(n)};
  if (exact) {
    since.information = open_.information.topLeftCorner(n, n);
    mirrorLower(since.information);
  }
  for (auto b = blocks_.rbegin(); b != blocks_.rend(); ++b) {
    const Block& block = **b;
    next -= block.count();
    for (std::size_t i = 0; i < block.count(); ++i) {
      const Eigen::Index row = block.first[i], rows = block.first[i + 1] - row;
      result[next + i] = since.estimate(variables_[next + i], block.own.block(row, row, rows, rows),
                                        block.F.middleCols(block.begin + row, rows));
    }
    since.goBack(block);
  }
  for (std::size_t i = 0; i < settled_->count(); ++i) {
    const Eigen::Index row = settled_->first[i], rows = settled_->first[i + 1] - row;
    result[i] = since.estimate(variables_[i], settled_->covariance.block(row, row, rows, rows),
                               cross_.middleCols(row, rows));
  }
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
  auto i = static_cast<std::size_t>(found - variables_.begin());
  Estimate estimate{*found, {}};
  inactive::Carried carried;
  const auto rowsIn = [&i](const auto& part) {
    return std::pair(part.first[i], part.first[i + 1] - part.first[i]);
  };
  auto block = blocks_.begin();
  if (i < settled_->count()) {
    const auto [row, rows] = rowsIn(*settled_);
    carried.join(cross_.middleCols(row, rows), Eigen::MatrixXd(rows, 0),
                 settled_->covariance.block(row, row, rows, rows));
  } else {
    i -= settled_->count();
    for (; block != blocks_.end() && i >= (*block)->count(); ++block) i -= (*block)->count();
    const Eigen::Index n = block == blocks_.end() ? open_.begin : (*block)->begin;
    const auto [row, rows] = block == blocks_.end() ? rowsIn(open_) : rowsIn(**block);
    if (block == blocks_.end()) return {estimateInOpen(i), open_.F.block(0, n + row, rows_, rows)};
    carried.join((*block)->F.middleCols(n + row, rows), Eigen::MatrixXd(rows, 0),
                 (*block)->own.block(row, row, rows, rows));
    ++block;
  }
  for (; block != blocks_.end(); ++block)
    carried.pass((*block)->F.leftCols((*block)->begin), (*block)->information, (*block)->correction);
  const Eigen::Index n = open_.begin;
  carried.pass(open_.F.topLeftCorner(rows_, n),
               Eigen::MatrixXd(open_.information.topLeftCorner(n, n).selfadjointView<Eigen::Lower>()),
               open_.correction.head(n));
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
  const auto bytesOf = [](const auto& m) { return static_cast<std::size_t>(m.size()) * sizeof(double); };
  const auto bytesOfBlock = [&](const Block& b) {
    return bytesOf(b.F) + bytesOf(b.information) + bytesOf(b.origin) + bytesOf(b.own);
  };
  std::size_t total = settled_->covariance.bytes() + cross_.bytes() + bytesOfBlock(open_);
  for (const auto& block : blocks_) total += bytesOfBlock(*block);
  return total;
}

} // namespace vi_ekf_slam
