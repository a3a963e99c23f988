#include "vi_ekf_slam/core/filter/inactive_store.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/filter/symmetric.hpp"
#include "vi_ekf_slam/core/filter/triangular.hpp"

namespace vi_ekf_slam {
namespace {

// A block ends when as many rows have left as half of those that it began with: with fewer there would be
// many blocks to settle, with more each update would have much to take along.
constexpr double kShareThatLeaves = 0.5;
constexpr double kMostThatLeave = 2.0; // of them, where a better moment to end it does not come

void grow(Eigen::MatrixXd& matrix, Eigen::Index rows, Eigen::Index cols) {
  if (rows <= matrix.rows() && cols <= matrix.cols()) return;
  const auto enough = [](Eigen::Index needed, Eigen::Index held) {
    return needed <= held ? held : needed + needed / 4;
  };
  matrix.conservativeResize(enough(rows, matrix.rows()), enough(cols, matrix.cols()));
}

/// Adds a variable's rows behind the others'.
void push(std::vector<InactiveVariable>& variables, std::vector<Eigen::Index>& first,
          InactiveVariable variable) {
  first.push_back(first.back() + variable.mean.size());
  variables.push_back(std::move(variable));
}

} // namespace

/// From here on: F = I, nothing learned.
void InactiveStore::begin(Eigen::Index rows) {
  rows_ = rows;
  open_.variables.clear();
  open_.first.assign(1, 0);
  open_.begin = rows;
  const Eigen::Index room = rows + static_cast<Eigen::Index>(kShareThatLeaves * static_cast<double>(rows));
  grow(open_.F, rows, room);
  grow(open_.information, room, room);
  open_.F.topLeftCorner(rows, rows).setIdentity();
  open_.information.topLeftCorner(rows, rows).setZero();
  open_.correction = Eigen::VectorXd::Zero(rows);
  open_.origin.resize(0, rows);
  open_.own.resize(0, 0);
}

/// Puts the open block behind the others. The next one must be begun.
void InactiveStore::close() {
  const Eigen::Index n = open_.begin, k = open_.left();
  auto block = std::make_shared<Block>();
  block->begin = n;
  block->first = open_.first;
  block->variables = std::move(open_.variables);
  block->F = map();
  block->information = open_.information.topLeftCorner(n, n);
  mirrorLower(block->information);
  block->correction = open_.correction.head(n);
  block->origin = open_.origin - open_.information.block(n, 0, k, n);
  block->own = open_.own - Eigen::MatrixXd(open_.information.block(n, n, k, k));
  mirrorLower(block->own);
  for (std::size_t i = 0; i < block->variables.size(); ++i)
    block->variables[i].mean +=
        open_.correction.segment(n + block->first[i], block->variables[i].mean.size());
  blocks_.push_back(std::move(block));
}

void InactiveStore::correct(const Innovation& in, const DirectUpdate* direct,
                            const std::vector<Variables::Reexpressed>& points) {
  if (isEmpty()) return;
  auto X = map();
  Eigen::MatrixXd HX(in.rows(), X.cols());
  in.applyH(X, HX);
  auto information = open_.information.topLeftCorner(X.cols(), X.cols());
  Eigen::MatrixXd weighted; // S^-1 H F
  if (direct) {
    weighted.noalias() = direct->inverseS() * HX;
    addLowerProduct(information, HX, weighted);
    direct->correctRows(X, HX, weighted, points);
  } else {
    weighted = std::move(HX);
    in.L().triangularView<Eigen::Lower>().solveInPlace(weighted);
    addLowerSquare(information, weighted);
    in.L().transpose().triangularView<Eigen::Upper>().solveInPlace(weighted);
    X.noalias() -= in.PHt() * weighted;
    reexpressRows(X, points);
  }
  open_.correction.noalias() += weighted.transpose() * in.residual();
}

void InactiveStore::learn(const Eigen::Ref<const Eigen::MatrixXd>& Gamma, const Eigen::VectorXd& correction) {
  if (isEmpty()) return;
  const auto X = map();
  const auto core = X.topRows(correction.size());
  open_.correction.noalias() += core.transpose() * correction;
  if (Gamma.cols() == 0) return;
  const Eigen::MatrixXd learned = Gamma.transpose() * core;
  addLowerSquare(open_.information.topLeftCorner(core.cols(), core.cols()), learned);
}

void InactiveStore::append(Eigen::Index rows, const LinearFunction& by) {
  if (isEmpty()) return;
  grow(open_.F, rows_ + rows, columns());
  auto added = open_.F.block(rows_, 0, rows, columns());
  added.setZero();
  if (!by.isNone()) added.noalias() = by.J * open_.F.block(by.row, 0, by.J.cols(), columns());
  rows_ += rows;
}

void InactiveStore::erase(const Variables::Gone& gone) {
  if (isEmpty()) return;
  eraseRows(map(), gone, rows_);
  rows_ -= gone.size;
}

void InactiveStore::forget(Eigen::Index row, Eigen::Index rows) {
  if (!isEmpty()) map().middleRows(row, rows).setZero();
}

void InactiveStore::add(Handle handle, const Eigen::VectorXd& mean, Eigen::Index row,
                        const Eigen::Ref<const Eigen::MatrixXd>& D,
                        const Eigen::Ref<const Eigen::MatrixXd>& own,
                        const Eigen::Ref<const Eigen::MatrixXd>& cross, bool ends_block) {
  const Eigen::Index k = mean.size();
  if (isEmpty()) {
    begin(cross.rows());
  } else if (static_cast<double>(open_.left()) >=
             (ends_block ? kShareThatLeaves : kMostThatLeave) * static_cast<double>(open_.begin)) {
    close();
    begin(rows_);
  }
  if (!serials_.emplace(handle, ++last_serial_).second)
    throw std::logic_error("variable " + std::to_string(handle) + " is inactive already");
  const Eigen::Index n = open_.begin, left = open_.left(), m = columns();
  // d in terms of x0, and its covariance with those that left before.
  const Eigen::MatrixXd origin = map().middleRows(row, k) + D * map().topRows(D.cols());
  open_.origin.conservativeResize(left + k, n);
  open_.origin.bottomRows(k) = origin.leftCols(n);
  open_.own.conservativeResize(left + k, left + k);
  open_.own.block(left, 0, k, left) = origin.rightCols(left);
  open_.own.block(left, left, k, k) = own;
  grow(open_.F, rows_, m + k);
  open_.F.block(0, m, rows_, k) = cross;
  grow(open_.information, m + k, m + k);
  open_.information.block(m, 0, k, m + k).setZero();
  open_.correction.conservativeResize(m + k);
  open_.correction.tail(k).setZero();
  push(open_.variables, open_.first, {handle, mean, mean});
}

InactiveStore::Settled& InactiveStore::ownSettled() {
  if (settled_.use_count() > 1) {
    settled_ = std::make_shared<Settled>(*settled_);
  } else {
    // The last other owner may have been a copy in another thread: letting go of one more owner here orders
    // what it read before what is written now (use_count() alone orders nothing).
    const std::shared_ptr<Settled> owner = settled_;
  }
  return *settled_;
}

/// Block by block from the last one: F, information and correction from the block's end to now, and `later`,
/// the d of those that left afterwards in terms of the active errors at its end.
void InactiveStore::settle() {
  if (isEmpty()) return;
  close();
  Settled& settled = ownSettled();
  const Eigen::Index old = settled.first.back(), size = rows_;
  const auto old_count = settled.variables.size();
  for (const auto& block : blocks_) {
    for (const InactiveVariable& variable : block->variables)
      push(settled.variables, settled.first, variable);
  }
  const Eigen::Index all = settled.first.back();
  SymmetricPanels& P = settled.covariance;
  P.resize(all);
  Eigen::MatrixXd cross(size, all);
  const std::shared_ptr<const Block> last = blocks_.back();
  blocks_.pop_back();
  Eigen::Index first = all - last->left();
  std::size_t next = settled.variables.size() - last->variables.size();
  cross.rightCols(last->left()) = last->F.rightCols(last->left());
  P.set(first, first, last->own);
  Eigen::MatrixXd F = last->F.leftCols(last->begin), information = last->information, later = last->origin;
  Eigen::VectorXd correction = last->correction;
  for (; !blocks_.empty(); blocks_.pop_back()) {
    const Block& block = *blocks_.back();
    const Eigen::Index own = block.left(), here = first - own;
    const auto block_F = block.F.leftCols(block.begin);
    const auto block_cross = block.F.rightCols(own);
    const Eigen::MatrixXd learned = block_cross.transpose() * information;
    cross.middleCols(here, own).noalias() = F * block_cross;
    P.set(first, here, later * block_cross);
    P.set(here, here, block.own - learned * block_cross);
    next -= block.variables.size();
    for (std::size_t i = 0; i < block.variables.size(); ++i) {
      InactiveVariable& variable = settled.variables[next + i];
      variable.mean += block_cross.middleCols(block.first[i], variable.mean.size()).transpose() * correction;
    }
    Eigen::MatrixXd joined(own + later.rows(), block.begin);
    joined.topRows(own) = block.origin;
    joined.topRows(own).noalias() -= learned * block_F;
    joined.bottomRows(later.rows()).noalias() = later * block_F;
    later.swap(joined);
    first = here;
    F = (F * block_F).eval();
    information = (block_F.transpose() * information * block_F).eval() + block.information;
    correction = block.correction + block_F.transpose() * correction;
  }
  if (old > 0) {
    const Eigen::MatrixXd& before = settled.cross;
    const Eigen::MatrixXd learned = information * before;
    P.subtractProduct(before, learned);
    for (std::size_t i = 0; i < old_count; ++i) {
      InactiveVariable& variable = settled.variables[i];
      variable.mean += before.middleCols(settled.first[i], variable.mean.size()).transpose() * correction;
    }
    cross.leftCols(old).noalias() = F * before;
    P.setProduct(old, later, before);
  }
  settled.cross.swap(cross);
  begin(size);
}

double InactiveStore::settlingCost() const {
  const auto n = static_cast<double>(rows_);
  const auto old = static_cast<double>(settled_->first.back());
  double left = static_cast<double>(open_.left());
  for (const auto& block : blocks_) left += static_cast<double>(block->left());
  const auto blocks = static_cast<double>(blocks_.size()); // to be composed with the open one
  return n * old * old + 2.0 * n * (n + left) * old + n * left * (n * blocks + left) +
         6.0 * n * n * n * blocks;
}

/// Where nothing is inactive, nothing is kept.
void InactiveStore::release() {
  if (!isEmpty()) return;
  settled_ = std::make_shared<Settled>();
  blocks_.clear();
  open_ = Block();
}

void InactiveStore::take(const std::vector<Handle>& handles, const Eigen::MatrixXd& with_others) {
  Settled& settled = ownSettled();
  settled.cross.conservativeResize(rows_ + with_others.rows(), Eigen::NoChange);
  settled.cross.bottomRows(with_others.rows()) = with_others;
  drop(handles);
  if (!isEmpty()) begin(settled.cross.rows());
}

/// Settled variables are no more.
void InactiveStore::drop(const std::vector<Handle>& handles) {
  for (const Handle handle : handles) serials_.erase(handle);
  Settled& settled = ownSettled();
  // What stays moves up, in its order.
  std::vector<Eigen::Index> from;
  std::vector<InactiveVariable> variables;
  std::vector<Eigen::Index> first{0};
  for (std::size_t i = 0; i < settled.variables.size(); ++i) {
    if (!contains(settled.variables[i].handle)) continue;
    const Eigen::Index begin = settled.first[i];
    for (Eigen::Index row = begin; row < settled.first[i + 1]; ++row) from.push_back(row);
    push(variables, first, std::move(settled.variables[i]));
  }
  const Eigen::Index rows = first.back();
  settled.covariance.keep(from);
  for (Eigen::Index column = 0; column < rows; ++column) {
    const Eigen::Index source = from[static_cast<std::size_t>(column)];
    if (source != column) settled.cross.col(column) = settled.cross.col(source);
  }
  settled.cross.conservativeResize(Eigen::NoChange, rows);
  settled.variables = std::move(variables);
  settled.first = std::move(first);
  release();
}

std::vector<Handle> InactiveStore::marginaliseOldest(std::size_t count) {
  std::vector<Handle> gone;
  for (const InactiveVariable& variable : settled_->variables) {
    if (gone.size() < count) gone.push_back(variable.handle);
  }
  if (!gone.empty()) drop(gone);
  while (gone.size() < count && !isEmpty()) {
    if (blocks_.empty()) {
      close();
      begin(rows_);
    }
    for (const InactiveVariable& variable : blocks_.front()->variables) {
      serials_.erase(variable.handle);
      gone.push_back(variable.handle);
    }
    blocks_.pop_front();
  }
  release();
  return gone;
}

void InactiveStore::adopt(std::vector<InactiveVariable> variables, const Eigen::MatrixXd& covariance,
                          Eigen::MatrixXd cross) {
  constexpr std::uint64_t kDeactivatedElsewhere = 1000000;
  *this = InactiveStore();
  begin(cross.rows());
  for (InactiveVariable& variable : variables) {
    if (!serials_.emplace(variable.handle, ++last_serial_).second)
      throw std::logic_error("variable " + std::to_string(variable.handle) + " is given twice");
    push(settled_->variables, settled_->first, std::move(variable));
  }
  last_serial_ += kDeactivatedElsewhere;
  settled_->covariance = SymmetricPanels(covariance);
  settled_->cross = std::move(cross);
  release();
}

void InactiveStore::setMeans(const std::vector<Eigen::VectorXd>& means) {
  auto& variables = ownSettled().variables;
  for (std::size_t i = 0; i < variables.size(); ++i) variables[i].mean = means[i];
}

} // namespace vi_ekf_slam
