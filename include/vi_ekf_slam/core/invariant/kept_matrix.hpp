#pragma once

#include <Eigen/Core>
#include <memory>
#include <utility>

#include "vi_ekf_slam/core/pooled_matrix.hpp"

namespace vi_ekf_slam::invariant {

/// A matrix that does not change any more, which copies share.
class KeptMatrix {
 public:
  KeptMatrix(PooledMatrix matrix); // NOLINT(google-explicit-constructor): it is one

  Eigen::Map<const Eigen::MatrixXd> operator*() const { return {data_.get(), rows_, cols_}; }

 private:
  friend class MatrixStore;
  KeptMatrix(std::shared_ptr<const double> data, Eigen::Index rows, Eigen::Index cols)
      : data_(std::move(data)), rows_(rows), cols_(cols) {}

  std::shared_ptr<const double> data_;
  Eigen::Index rows_, cols_;
};

/// Memory for many matrices that are let go of in about the order in which they came, for hours: in large
/// pieces, which the system gets back whole. Copies fill the same piece, from any thread.
class MatrixStore {
 public:
  MatrixStore();

  /// The matrix, from now on in here. Throws std::bad_alloc.
  KeptMatrix keep(const Eigen::Ref<const Eigen::MatrixXd>& matrix);

  /// An empty one that uses the pieces which this one does not need any more: for matrices that live longer.
  MatrixStore another() const { return MatrixStore(pool_); }

 private:
  class Piece;
  class Pool;
  explicit MatrixStore(std::shared_ptr<Pool> pool) : pool_(std::move(pool)) {}
  std::shared_ptr<Piece> pooledPiece() const;

  std::shared_ptr<Pool> pool_; // copies share it
  std::shared_ptr<Piece> piece_;
};

} // namespace vi_ekf_slam::invariant
