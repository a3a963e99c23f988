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

  /// Of those of a part: `own` of one's rows (row, rows) its covariance there, `cross` of some (first row,
  /// rows) that with the active errors at the block's end.
  template <class Own, class Cross>
  void estimate(const std::vector<Eigen::Index>& first, const InactiveVariable* variables, const Own& own,
                const Cross& cross, InactiveStore::Estimate* result) const {
    constexpr std::size_t kAtATime = 64;
    const std::size_t count = first.size() - 1;
    for (std::size_t begin = 0; begin < count; begin += kAtATime) {
      const std::size_t end = std::min(count, begin + kAtATime);
      const Eigen::MatrixXd C = cross(first[begin], first[end] - first[begin]);
      const Eigen::VectorXd moved = C.transpose() * correction;
      Eigen::MatrixXd learned;
      if (information.size() > 0) learned.noalias() = information * C;
      for (std::size_t i = begin; i < end; ++i) {
        const Eigen::Index row = first[i] - first[begin], rows = first[i + 1] - first[i];
        result[i] = {variables[i], own(first[i], rows)};
        result[i].variable.mean += moved.segment(row, rows);
        if (information.size() > 0)
          result[i].covariance.noalias() -=
              C.middleCols(row, rows).transpose() * learned.middleCols(row, rows);
        mirrorLower(result[i].covariance);
      }
    }
  }
  /// From the end of a block to its beginning.
  void goBack(const inactive::Block& block) {
    correction = block.back(correction.transpose()).transpose() + block.correction();
    if (information.size() == 0) return;
    const Eigen::MatrixXd half = block.back(information).transpose();
    information = block.back(half) + block.information();
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
    since.estimate(
        block.first, &variables_[next],
        [&](Eigen::Index row, Eigen::Index rows) { return block.own->block(row, row, rows, rows); },
        [&](Eigen::Index row, Eigen::Index rows) { return block.cross.middleCols(row, rows); },
        &result[next]);
    since.goBack(block);
  }
  since.estimate(
      settled_->first, variables_.data(),
      [&](Eigen::Index row, Eigen::Index rows) { return settled_->covariance.block(row, row, rows, rows); },
      [&](Eigen::Index row, Eigen::Index rows) { return cross_.middleCols(row, rows); }, result.data());
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
    const auto [row, rows] = block == blocks_.end() ? rowsIn(open_) : rowsIn(**block);
    if (block == blocks_.end()) return {estimateInOpen(i), open_.F.block(0, open_.begin + row, rows_, rows)};
    carried.join((*block)->cross.middleCols(row, rows), Eigen::MatrixXd(rows, 0),
                 (*block)->own->block(row, row, rows, rows));
    ++block;
  }
  for (; block != blocks_.end(); ++block) (*block)->pass(carried);
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
  for (const auto& block : blocks_) total += block->bytes();
  return total + static_cast<std::size_t>(open) * sizeof(double);
}

} // namespace vi_ekf_slam
