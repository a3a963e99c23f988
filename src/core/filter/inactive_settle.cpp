// What InactiveStore has deferred, done: here, or in a thread beside.

#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/filter/inactive_store.hpp"

namespace vi_ekf_slam {
namespace {

bool isOwnedAlone(const std::shared_ptr<inactive::Settled>& held) {
  if (held.use_count() != 1) return false;
  // The last other owner may have been in another thread: letting go of one more owner here orders what it
  // read before what is written now (use_count() alone orders nothing).
  { const std::shared_ptr<inactive::Settled> owner = held; }
  return true;
}

} // namespace

namespace inactive {
namespace {

/// What stays moves up, in its order.
void keep(Settled& settled, Eigen::MatrixXd& cross, const std::vector<std::size_t>& kept) {
  if (kept.size() == settled.count()) return;
  std::vector<Eigen::Index> rows, first{0};
  for (const std::size_t i : kept) {
    for (Eigen::Index row = settled.first[i]; row < settled.first[i + 1]; ++row) rows.push_back(row);
    first.push_back(static_cast<Eigen::Index>(rows.size()));
  }
  settled.first = std::move(first);
  settled.covariance.keep(rows);
  cross = columnsOf(cross, rows);
}

} // namespace

/// Block by block from the last one: F and what was learned from the block's end to now, and `later`, the d
/// of those that left afterwards in terms of the active errors at its end.
Composed composed(Settled settled, Eigen::MatrixXd before, const std::vector<std::size_t>& kept,
                  const std::deque<std::shared_ptr<const Block>>& blocks) {
  keep(settled, before, kept);
  const Eigen::Index old = settled.left();
  for (const auto& block : blocks) {
    const Eigen::Index first = settled.left();
    for (std::size_t i = 0; i < block->count(); ++i) settled.first.push_back(first + block->first[i + 1]);
  }
  const Eigen::Index all = settled.left();
  SymmetricPanels& P = settled.covariance;
  P.resize(all);
  const Eigen::Index end = blocks.back()->atEnd();
  Composed result;
  Eigen::MatrixXd cross(end, all);
  result.moved = Eigen::VectorXd::Zero(all);
  Eigen::Index first = all;
  Eigen::MatrixXd F = Eigen::MatrixXd::Identity(end, end), later(0, end);
  Since since{Eigen::MatrixXd::Zero(end, end), Eigen::VectorXd::Zero(end)};
  for (auto b = blocks.rbegin(); b != blocks.rend(); ++b) {
    const Block& block = **b;
    const Eigen::Index own = block.left(), here = first - own;
    const Eigen::MatrixXd block_cross = block.cross.all();
    const Eigen::MatrixXd learned = block_cross.transpose() * since.information;
    cross.middleCols(here, own).noalias() = F * block_cross;
    P.set(first, here, later * block_cross);
    P.set(here, here, *block.own - learned * block_cross);
    result.moved.segment(here, own).noalias() = block_cross.transpose() * since.correction;
    Eigen::MatrixXd joined(own + later.rows(), block.atBegin());
    joined.topRows(own) = -block.back(learned);
    joined.topLeftCorner(own, block.origin->cols()) += *block.origin;
    joined.bottomRows(later.rows()) = block.back(later);
    later.swap(joined);
    first = here;
    F = block.back(F);
    since.goBack(block);
  }
  if (old > 0) {
    const Eigen::MatrixXd learned = since.information * before;
    P.subtractProduct(before, learned);
    result.moved.head(old).noalias() = before.transpose() * since.correction;
    cross.leftCols(old).noalias() = F * before;
    P.setProduct(old, later, before);
  }
  result.cross.push(std::move(cross));
  result.settled = std::make_shared<Settled>(std::move(settled));
  return result;
}

} // namespace inactive

/// For a change; a copy where another store has it too.
inactive::Settled InactiveStore::takeSettled() {
  const auto held = std::exchange(settled_, nullptr);
  return isOwnedAlone(held) ? std::move(*held) : *held;
}

void InactiveStore::settle() {
  endSettling();
  if (isEmpty()) return;
  close();
  Eigen::MatrixXd before = cross_.all();
  cross_ = {};
  const auto kept = keptOfSettled();
  accept(inactive::composed(takeSettled(), std::move(before), kept, blocks_), begun());
  begin(rows_);
}

void InactiveStore::beginSettling() {
  if (settling_.valid() || blocks_.empty()) return;
  begun_ = begun();
  // To give back that much memory takes longer than a frame has, and the matrix's is wanted again.
  auto settle = [settled = settled_, cross = cross_, kept = keptOfSettled(), blocks = blocks_,
                 replaced = std::exchange(replaced_, {})]() mutable {
    inactive::Settled copy;
    if (isOwnedAlone(replaced.settled)) copy = std::move(*replaced.settled);
    replaced = {};
    copy = *settled;
    return inactive::composed(std::move(copy), cross.all(), kept, blocks);
  };
  settling_ = std::async(std::launch::async | std::launch::deferred, std::move(settle)).share();
}

void InactiveStore::endSettling() {
  if (!settling_.valid()) return;
  const inactive::Composed composed = settling_.get();
  replaced_ = {settled_, cross_,
               Blocks(blocks_.begin(), blocks_.begin() + static_cast<std::ptrdiff_t>(begun_.blocks))};
  settling_ = {};
  accept(composed, begun_);
}

InactiveStore::Begun InactiveStore::begun() const {
  const auto open = variables_.end() - static_cast<std::ptrdiff_t>(open_.count());
  Begun result{blocks_.size(), {}, {}, last_serial_};
  if (open != variables_.end()) result.last_serial = serials_.at(open->handle) - 1;
  for (auto variable = variables_.begin(); variable != open; ++variable) {
    if (variable->handle != kTaken) result.handles.push_back(variable->handle);
  }
  return result;
}

/// In the place of the first blocks and of what was settled. One that was taken meanwhile leaves its place;
/// its covariance with the others is that of an active error from here on, as it is in the blocks that
/// follow.
void InactiveStore::accept(const inactive::Composed& composed, const Begun& begun) {
  const inactive::Settled& settled = *composed.settled;
  std::vector<InactiveVariable> variables;
  std::unordered_map<Handle, std::size_t> empty; // places
  auto next = variables_.cbegin();
  const auto skip = [&] {
    while (next != variables_.cend() && next->handle == kTaken) ++next;
  };
  for (std::size_t i = 0; i < begun.handles.size(); ++i) {
    const Handle handle = begun.handles[i];
    const Eigen::Index size = settled.first[i + 1] - settled.first[i];
    const auto serial = serials_.find(handle);
    if (serial == serials_.end() || serial->second > begun.last_serial) {
      variables.push_back({kTaken, SmallVector::Zero(size), SmallVector::Zero(size)});
      empty.emplace(handle, i);
      continue;
    }
    skip();
    variables.push_back(*next++);
    variables.back().mean += composed.moved.segment(settled.first[i], size);
  }
  for (skip(); next != variables_.cend(); ++next) variables.push_back(*next);
  variables_ = std::move(variables);
  settled_ = composed.settled;
  cross_ = composed.cross;
  if (!begun.taken.empty()) {
    std::vector<Eigen::Index> rows;
    for (const Handle handle : begun.taken) {
      const std::size_t i = empty.at(handle);
      for (Eigen::Index row = settled.first[i]; row < settled.first[i + 1]; ++row) rows.push_back(row);
    }
    cross_.push(inactive::rowsOf(settled.covariance, rows));
  }
  blocks_.erase(blocks_.begin(), blocks_.begin() + static_cast<std::ptrdiff_t>(begun.blocks));
}

/// By number.
std::vector<std::size_t> InactiveStore::keptOfSettled() const {
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < settled_->count(); ++i) {
    if (variables_[i].handle != kTaken) kept.push_back(i);
  }
  return kept;
}

/// Of the products in composed().
double InactiveStore::settlingCost() const {
  const auto of = [](Eigen::Index size) { return static_cast<double>(size); };
  if (blocks_.empty()) return 0.0;
  const double size = of(blocks_.back()->atEnd());
  double later = 0.0, begin = size, cost = 0.0;
  for (auto b = blocks_.rbegin(); b != blocks_.rend(); ++b) {
    const Block& block = **b;
    const double end = begin, left = of(block.left());
    begin = of(block.atBegin());
    cost +=
        2.0 * end *
        (left * (end + left + size + later) + of(block.origin->cols()) * (left + size + later + end + begin));
    later += left;
  }
  const double old = of(settled_->left());
  return cost + begin * old * (old + 2.0 * (size + later + begin));
}

} // namespace vi_ekf_slam
