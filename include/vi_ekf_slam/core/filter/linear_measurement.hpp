#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

namespace vi_ekf_slam {

/// Up to six numbers, or six by six, without memory of their own.
using SmallVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 6, 1>;
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 6, 6>;

/// J x of the rows [row, row + columns of J) of an error vector x; nothing by default.
struct LinearFunction {
  Eigen::Index row = 0;
  Eigen::MatrixXd J;
  bool isNone() const { return J.size() == 0; }
  /// And what later rows have, from `first` on.
  void add(Eigen::Index first, const Eigen::MatrixXd& more) {
    if (isNone()) row = first;
    const Eigen::Index before = J.cols();
    J.conservativeResize(more.rows(), first + more.cols() - row);
    J.rightCols(J.cols() - before).setZero();
    J.rightCols(more.cols()) = more;
  }
};

/// A measurement of r rows, 1 to 6, linearised at the means: residual = z - h(x^) = sum of H_k e_k + n, with
/// n of covariance `noise` (r x r), independent of all else. e_k are the errors of up to three variables, or
/// parts of them.
class LinearMeasurement {
 public:
  struct Term {
    Eigen::Index column = 0; ///< of the filter's error vector, the first one
    SmallMatrix H;           ///< r rows
  };

  LinearMeasurement(SmallVector residual, SmallMatrix noise)
      : residual_(std::move(residual)), noise_(std::move(noise)) {}

  // Of the terms only those that there are.
  LinearMeasurement(const LinearMeasurement& other) { *this = other; }
  LinearMeasurement& operator=(const LinearMeasurement& other) {
    residual_ = other.residual_;
    noise_ = other.noise_;
    count_ = other.count_;
    std::copy_n(other.terms_.begin(), count_, terms_.begin());
    return *this;
  }

  LinearMeasurement& by(Eigen::Index column, const SmallMatrix& H) {
    terms_.at(count_++) = {column, H};
    return *this;
  }

  void addNoise(const SmallMatrix& more) { noise_ += more; }

  Eigen::Index rows() const { return residual_.size(); }
  const SmallVector& residual() const { return residual_; }
  const SmallMatrix& noise() const { return noise_; }
  std::size_t termCount() const { return count_; }
  const Term& term(std::size_t k) const { return terms_[k]; }
  const Term* begin() const { return terms_.data(); }
  const Term* end() const { return terms_.data() + count_; }

  /// Whether only errors of the first `rows` rows take part.
  bool isWithin(Eigen::Index rows) const {
    for (const Term& term : *this) {
      if (term.column + term.H.cols() > rows) return false;
    }
    return true;
  }

  /// result += X H^T, for X with a column for each of the errors.
  template <class Matrix, class Result>
  void addTransposedProduct(const Matrix& X, Result&& result) const {
    for (const Term& term : *this) {
      if (term.H.rows() == 3 && term.H.cols() == 3)
        result.noalias() +=
            X.template middleCols<3>(term.column).lazyProduct(Eigen::Matrix3d(term.H).transpose());
      else
        result.noalias() += X.middleCols(term.column, term.H.cols()).lazyProduct(term.H.transpose());
    }
  }

  /// result += H X, for X with the rows of the error vector.
  template <class Matrix, class Result>
  void addProduct(const Matrix& X, Result&& result) const {
    for (const Term& term : *this) {
      if (term.H.rows() == 3 && term.H.cols() == 3)
        result.noalias() += Eigen::Matrix3d(term.H) * X.template middleRows<3>(term.column);
      else
        result.noalias() += term.H * X.middleRows(term.column, term.H.cols());
    }
  }

 private:
  SmallVector residual_;
  SmallMatrix noise_;
  std::array<Term, 3> terms_;
  std::size_t count_ = 0;
};

} // namespace vi_ekf_slam
