// What InactiveStore says of its variables without settling them.

#include <algorithm>
#include <stdexcept>
#include <string>

#include "vi_ekf_slam/core/filter/inactive_store.hpp"
#include "vi_ekf_slam/core/filter/symmetric.hpp"

namespace vi_ekf_slam {
namespace {

/// What has happened since the end of a block to those that left in it or before: F, information and
/// correction, of which the first two are empty where they are not asked for.
struct Since {
  Eigen::MatrixXd F, information;
  Eigen::VectorXd correction;

  /// Of a variable that left as `variable` with covariance own(row, row), and `cross` with the active errors
  /// at the block's end.
  template <class Matrix>
  InactiveStore::Estimate estimate(const InactiveVariable& variable, const Matrix& own, Eigen::Index row,
                                   const Eigen::Ref<const Eigen::MatrixXd>& cross) const {
    const Eigen::Index rows = variable.mean.size();
    InactiveStore::Estimate now{variable, own.block(row, row, rows, rows)};
    now.variable.mean += cross.transpose() * correction;
    if (information.size() > 0) now.covariance -= cross.transpose() * (information * cross).eval();
    mirrorLower(now.covariance);
    return now;
  }
  /// From the end of a block to its beginning.
  void goBack(const Eigen::Ref<const Eigen::MatrixXd>& block_F, const Eigen::MatrixXd& learned,
              const Eigen::VectorXd& moved) {
    correction = (moved + block_F.transpose() * correction).eval();
    if (information.size() > 0)
      information = (block_F.transpose() * information * block_F).eval() + learned;
    if (F.size() > 0) F = (F * block_F).eval();
  }
};

} // namespace

/// Of one that has left in the open block: the block's information holds what was learned of it since.
InactiveStore::Estimate InactiveStore::estimateInOpen(std::size_t i) const {
  const Eigen::Index n = open_.begin, row = open_.first[i], rows = open_.first[i + 1] - row;
  Estimate estimate{open_.variables[i], open_.own.block(row, row, rows, rows)};
  estimate.variable.mean += open_.correction.segment(n + row, rows);
  estimate.covariance -= open_.information.block(n + row, n + row, rows, rows);
  mirrorLower(estimate.covariance);
  return estimate;
}

std::vector<InactiveStore::Estimate> InactiveStore::estimates(bool exact) const {
  std::vector<Estimate> result(size());
  std::size_t next = size() - open_.variables.size();
  for (std::size_t i = 0; i < open_.variables.size(); ++i) result[next + i] = estimateInOpen(i);
  if (next == 0) return result;
  const Eigen::Index n = open_.begin;
  Since since{{}, {}, open_.correction.head(n)};
  if (exact) {
    since.information = open_.information.topLeftCorner(n, n);
    mirrorLower(since.information);
  }
  for (auto b = blocks_.rbegin(); b != blocks_.rend(); ++b) {
    const Block& block = **b;
    next -= block.variables.size();
    for (std::size_t i = 0; i < block.variables.size(); ++i) {
      const Eigen::Index row = block.first[i], rows = block.first[i + 1] - row;
      result[next + i] =
          since.estimate(block.variables[i], block.own, row, block.F.middleCols(block.begin + row, rows));
    }
    since.goBack(block.F.leftCols(block.begin), block.information, block.correction);
  }
  for (std::size_t i = 0; i < settled_->variables.size(); ++i) {
    const Eigen::Index row = settled_->first[i], rows = settled_->first[i + 1] - row;
    result[i] = since.estimate(settled_->variables[i], settled_->covariance, row,
                               settled_->cross.middleCols(row, rows));
  }
  return result;
}

InactiveStore::Related InactiveStore::related(Handle handle) const {
  const auto indexIn = [handle](const std::vector<InactiveVariable>& variables) {
    const auto found = std::find_if(variables.begin(), variables.end(),
                                    [handle](const InactiveVariable& v) { return v.handle == handle; });
    return static_cast<std::size_t>(found - variables.begin());
  };
  const Eigen::Index n = open_.begin;
  if (const std::size_t i = indexIn(open_.variables); i < open_.variables.size()) {
    const Eigen::Index row = open_.first[i], rows = open_.first[i + 1] - row;
    return {estimateInOpen(i), open_.F.block(0, n + row, rows_, rows)};
  }
  Since since{open_.F.topLeftCorner(rows_, n), open_.information.topLeftCorner(n, n),
              open_.correction.head(n)};
  mirrorLower(since.information);
  for (auto b = blocks_.rbegin(); b != blocks_.rend(); ++b) {
    const Block& block = **b;
    if (const std::size_t i = indexIn(block.variables); i < block.variables.size()) {
      const Eigen::Index row = block.first[i], rows = block.first[i + 1] - row;
      const auto cross = block.F.middleCols(block.begin + row, rows);
      return {since.estimate(block.variables[i], block.own, row, cross), since.F * cross};
    }
    since.goBack(block.F.leftCols(block.begin), block.information, block.correction);
  }
  const std::size_t i = indexIn(settled_->variables);
  if (i == settled_->variables.size())
    throw std::out_of_range("variable " + std::to_string(handle) + " is not inactive");
  const Eigen::Index row = settled_->first[i], rows = settled_->first[i + 1] - row;
  const auto cross = settled_->cross.middleCols(row, rows);
  return {since.estimate(settled_->variables[i], settled_->covariance, row, cross), since.F * cross};
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
  std::size_t total = settled_->covariance.bytes() + bytesOf(settled_->cross) + bytesOfBlock(open_);
  for (const auto& block : blocks_) total += bytesOfBlock(*block);
  return total;
}

} // namespace vi_ekf_slam
