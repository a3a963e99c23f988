#include "vi_ekf_slam/core/filter/inactive_store.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/filter/symmetric.hpp"
#include "vi_ekf_slam/core/filter/triangular.hpp"

namespace vi_ekf_slam {
namespace {

// A block ends when as many rows have left, or come back, as half of those that it began with: with fewer
// there would be many blocks to settle, with more each update would have much to take along.
constexpr double kShareThatLeaves = 0.5;
constexpr double kMostThatLeave = 2.0; // of them, where a better moment to end it does not come
// Who stands or turns about loses few, and would take them along for ever: over so many updates twice the
// columns cost as much as a block that is settled.
constexpr double kLongestSurplus = 30.0;

} // namespace

/// From here on: F = I, nothing learned.
void InactiveStore::begin(Eigen::Index rows) {
  rows_ = began_with_ = rows;
  surplus_ = 0.0;
  open_.first.assign(1, 0);
  open_.begin = rows;
  const Eigen::Index room = rows + static_cast<Eigen::Index>(kShareThatLeaves * static_cast<double>(rows));
  inactive::grow(open_.F, rows, room);
  inactive::grow(open_.information, room, room);
  open_.F.topLeftCorner(rows, rows).setIdentity();
  open_.information.topLeftCorner(rows, rows).setZero();
  open_.correction = Eigen::VectorXd::Zero(rows);
  open_.origin.resize(0, rows);
  open_.own.resize(0, 0);
}

Eigen::MatrixXd InactiveStore::originNow() const {
  return open_.origin - open_.information.block(open_.begin, 0, open_.left(), open_.begin);
}

Eigen::MatrixXd InactiveStore::ownNow() const {
  const Eigen::Index n = open_.begin, k = open_.left();
  Eigen::MatrixXd own = open_.own - Eigen::MatrixXd(open_.information.block(n, n, k, k));
  mirrorLower(own);
  return own;
}

/// The open block as one that ends now.
InactiveStore::Block InactiveStore::closed() const {
  const Eigen::Index n = open_.begin, k = open_.left();
  Eigen::MatrixXd information = open_.information.topLeftCorner(n, n);
  mirrorLower(information);
  Block block;
  block.passage = std::make_shared<const Block::Passage>(
      Block::Passage{open_.F.topLeftCorner(rows_, n), std::move(information), open_.correction.head(n)});
  block.first = open_.first;
  block.cross.push(open_.F.block(0, n, rows_, k));
  block.origin = std::make_shared<const Eigen::MatrixXd>(originNow());
  block.own = std::make_shared<const Eigen::MatrixXd>(ownNow());
  return block;
}

/// Puts the open block behind the others. The next one must be begun.
void InactiveStore::close() {
  blocks_.push_back(std::make_shared<const Block>(closed()));
  const std::size_t before = variables_.size() - open_.count();
  for (std::size_t i = 0; i < open_.count(); ++i) {
    SmallVector& mean = variables_[before + i].mean;
    mean += open_.correction.segment(open_.begin + open_.first[i], mean.size());
  }
}

/// Without a direct update by W = L^-1 H F and `root`: S may be as large as an unknown pose makes it, and
/// S^-1 H F would have twice as few digits.
void InactiveStore::correct(const Innovation& in, const DirectUpdate* direct, const Eigen::MatrixXd& root,
                            const std::vector<Variables::Reexpressed>& points) {
  if (isEmpty()) return;
  surplus_ += static_cast<double>(columns() - began_with_) / static_cast<double>(began_with_);
  if (surplus_ > kLongestSurplus) {
    close();
    begin(rows_);
  }
  auto X = map();
  Eigen::MatrixXd HX(in.rows(), X.cols());
  in.applyH(X, HX);
  auto information = open_.information.topLeftCorner(X.cols(), X.cols());
  if (direct) {
    const Eigen::MatrixXd weighted = direct->inverseS() * HX; // S^-1 H F
    addLowerProduct(information, HX, weighted);
    direct->correctRows(X, HX, weighted, points);
    open_.correction.noalias() += weighted.transpose() * in.residual();
    return;
  }
  const auto L = in.L().triangularView<Eigen::Lower>();
  L.solveInPlace(HX);
  addLowerSquare(information, HX);
  X.noalias() -= root * HX;
  reexpressRows(X, points);
  const Eigen::VectorXd white = L.solve(in.residual());
  open_.correction.noalias() += HX.transpose() * white;
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
  inactive::grow(open_.F, rows_ + rows, columns());
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
  if (k > SmallVector::MaxRowsAtCompileTime)
    throw std::logic_error("an inactive variable of " + std::to_string(k) + " rows");
  if (isEmpty()) {
    begin(cross.rows());
  } else if (static_cast<double>(columns() - began_with_) >=
             (ends_block ? kShareThatLeaves : kMostThatLeave) * static_cast<double>(began_with_)) {
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
  inactive::grow(open_.F, rows_, m + k);
  open_.F.block(0, m, rows_, k) = cross;
  inactive::grow(open_.information, m + k, m + k);
  open_.information.block(m, 0, k, m + k).setZero();
  open_.correction.conservativeResize(m + k);
  open_.correction.tail(k).setZero();
  open_.first.push_back(open_.left() + k);
  variables_.push_back({handle, mean, mean});
}

/// Nothing is kept for what is not there any more.
void InactiveStore::release() {
  if (isEmpty()) {
    variables_.clear();
    blocks_.clear();
    open_ = OpenBlock();
    settling_ = {};
    replaced_ = {};
  } else if (!keptOfSettled().empty() || settled_->count() == 0) {
    return;
  } else {
    variables_.erase(variables_.begin(), variables_.begin() + static_cast<std::ptrdiff_t>(settled_->count()));
  }
  settled_ = std::make_shared<inactive::Settled>();
  cross_ = {};
}

std::vector<Handle> InactiveStore::marginaliseOldest(std::size_t count) {
  endSettling();
  std::vector<Handle> gone;
  for (const std::size_t i : keptOfSettled()) {
    if (gone.size() == count) break;
    gone.push_back(std::exchange(variables_[i].handle, kTaken)); // its place goes when all is settled
    serials_.erase(gone.back());
  }
  release();
  while (gone.size() < count && !isEmpty()) {
    if (blocks_.empty()) {
      close();
      begin(rows_);
    }
    const auto end = variables_.begin() + static_cast<std::ptrdiff_t>(blocks_.front()->count());
    for (auto variable = variables_.begin(); variable != end; ++variable) {
      serials_.erase(variable->handle);
      gone.push_back(variable->handle);
    }
    variables_.erase(variables_.begin(), end);
    blocks_.pop_front();
    release();
  }
  return gone;
}

void InactiveStore::adopt(std::vector<InactiveVariable> variables, const Eigen::MatrixXd& covariance,
                          Eigen::MatrixXd cross) {
  constexpr std::uint64_t kDeactivatedElsewhere = 1000000;
  *this = InactiveStore();
  begin(cross.rows());
  for (const InactiveVariable& variable : variables) {
    if (!serials_.emplace(variable.handle, ++last_serial_).second)
      throw std::logic_error("variable " + std::to_string(variable.handle) + " is given twice");
    settled_->first.push_back(settled_->left() + variable.mean.size());
  }
  variables_ = std::move(variables);
  last_serial_ += kDeactivatedElsewhere;
  settled_->covariance = SymmetricPanels(covariance);
  cross_.push(std::move(cross));
  release();
}

void InactiveStore::move(const std::vector<SmallVector>& by) {
  auto next = by.begin();
  for (InactiveVariable& variable : variables_) {
    if (variable.handle != kTaken) variable.mean += *next++;
  }
}

} // namespace vi_ekf_slam
