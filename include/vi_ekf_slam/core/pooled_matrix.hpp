#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <new>

#include "vi_ekf_slam/core/memory_pool.hpp"

namespace vi_ekf_slam {

/// An Eigen matrix or vector of dynamic size whose memory is the pool's: what a frame works with comes and
/// goes without an allocation. It is used as a Plain is; in place of being resized it is assigned another
/// one.
template <class PlainMatrix>
class Pooled : public Eigen::Map<PlainMatrix, Eigen::Aligned64> {
 public:
  using Plain = PlainMatrix;
  using Base = Eigen::Map<Plain, Eigen::Aligned64>;

  Pooled() : Base(nullptr, kNoRows, kNoCols) {}
  /// Not initialised.
  Pooled(Eigen::Index rows, Eigen::Index cols) : Base(take(rows, cols), rows, cols) {}
  Pooled(const Pooled& other) : Pooled(other.rows(), other.cols()) { Base::operator=(other); }
  Pooled(Pooled&& other) noexcept : Pooled() { swap(other); }
  /// What an expression comes to.
  template <class Expression>
  Pooled(
      const Eigen::MatrixBase<Expression>& expression) // NOLINT(google-explicit-constructor): as Eigen's are
      : Pooled(expression.rows(), expression.cols()) {
    this->noalias() = expression;
  }
  ~Pooled() { giveBackPooled(this->data(), bytesOf(this->rows(), this->cols())); }

  Pooled& operator=(const Pooled& other) { return *this = Pooled(other); }
  Pooled& operator=(Pooled&& other) noexcept {
    swap(other);
    return *this;
  }
  /// Of any size.
  template <class Expression>
  Pooled& operator=(const Eigen::MatrixBase<Expression>& expression) {
    return *this = Pooled(expression);
  }

  void swap(Pooled& other) noexcept {
    const Base own = *this;
    seat(other);
    other.seat(own);
  }

 private:
  static constexpr Eigen::Index kNoRows =
      Plain::RowsAtCompileTime == Eigen::Dynamic ? 0 : Plain::RowsAtCompileTime;
  static constexpr Eigen::Index kNoCols =
      Plain::ColsAtCompileTime == Eigen::Dynamic ? 0 : Plain::ColsAtCompileTime;
  using Scalar = typename Plain::Scalar;
  static_assert(static_cast<std::size_t>(Eigen::Aligned64) <= kPoolAlignment);

  static std::size_t bytesOf(Eigen::Index rows, Eigen::Index cols) {
    return static_cast<std::size_t>(rows * cols) * sizeof(Scalar);
  }
  static Scalar* take(Eigen::Index rows, Eigen::Index cols) {
    return rows * cols == 0 ? nullptr : static_cast<Scalar*>(takePooled(bytesOf(rows, cols)));
  }
  /// As Eigen's documentation has it for a Map that is to be elsewhere.
  void seat(const Base& map) noexcept {
    new (static_cast<Base*>(this)) Base(const_cast<Scalar*>(map.data()), map.rows(), map.cols());
  }
};

using PooledMatrix = Pooled<Eigen::MatrixXd>;

} // namespace vi_ekf_slam
