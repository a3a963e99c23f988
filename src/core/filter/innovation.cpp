#include "vi_ekf_slam/core/filter/innovation.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include "vi_ekf_slam/core/filter/four_by_three.hpp"
#include "vi_ekf_slam/core/filter/triangular.hpp"

namespace vi_ekf_slam {

namespace {

/// Of H: three rows, and the columns of one variable.
struct Block {
  Eigen::Index row, column;
  FourByThree H;
};

/// Those of the first `count` measurements, stacked; other(i, term) for each term of another size.
template <class Other>
std::vector<Block> blocksOf(const std::vector<LinearMeasurement>& measurements, std::size_t count,
                            const Other& other) {
  std::vector<Block> blocks;
  Eigen::Index row = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const LinearMeasurement& z = measurements[i];
    for (const LinearMeasurement::Term& term : z) {
      if (z.rows() == 3 && term.H.cols() == 3)
        blocks.push_back({row, term.column, FourByThree(term.H)});
      else
        other(i, term);
    }
    row += z.rows();
  }
  return blocks;
}

} // namespace

Innovation::Innovation(const Eigen::Ref<const Eigen::MatrixXd>& P,
                       std::vector<LinearMeasurement> measurements)
    : measurements_(std::move(measurements)), used_(measurements_.size()) {
  stack();
  PHt_.resize(P.rows(), rows());
  for (std::size_t i = 0; i < measurements_.size(); ++i) {
    const LinearMeasurement& z = measurements_[i];
    bool begun = false;
    const auto add = [&begun](auto columns, const auto& product) {
      if (begun)
        columns.noalias() += product;
      else
        columns.noalias() = product;
      begun = true;
    };
    for (const LinearMeasurement::Term& term : z) {
      if (term.H.rows() == 3 && term.H.cols() == 3) {
        const Eigen::Matrix3d Ht = term.H.transpose();
        add(PHt_.middleCols<3>(first_[i]), P.middleCols<3>(term.column).lazyProduct(Ht));
      } else {
        add(PHt_.middleCols(first_[i], z.rows()),
            P.middleCols(term.column, term.H.cols()) * term.H.transpose());
      }
    }
    if (!begun) PHt_.middleCols(first_[i], z.rows()).setZero();
  }
  S_.resize(rows(), rows());
  const bool are_direct =
      std::all_of(measurements_.begin(), measurements_.end(), [](const LinearMeasurement& z) {
        return z.rows() == 3 && z.termCount() == 1 && z.term(0).H.cols() == 3;
      });
  if (!are_direct) S_.setZero();
  const auto blocks = blocksOf(measurements_, measurements_.size(), [this](std::size_t i, const auto& term) {
    S_.block(first_[i], 0, term.H.rows(), first_[i + 1]).noalias() +=
        term.H * PHt_.block(term.column, 0, term.H.cols(), first_[i + 1]);
  });
  for (Eigen::Index column = 0; column < rows(); ++column) {
    for (const Block& block : blocks) {
      if (block.row + 2 < column) continue;
      auto three = S_.col(column).segment<3>(block.row);
      const Eigen::Vector3d added = block.H.times(PHt_.col(column).segment<3>(block.column));
      three = are_direct ? added : Eigen::Vector3d(three + added);
    }
  }
  for (std::size_t i = 0; i < measurements_.size(); ++i) {
    const LinearMeasurement& z = measurements_[i];
    S_.block(first_[i], first_[i], z.rows(), z.rows()) += z.noise();
  }
  column_.resize(static_cast<std::size_t>(rows()));
  std::iota(column_.begin(), column_.end(), 0);
}

void Innovation::stack() {
  first_.assign(1, 0);
  for (const LinearMeasurement& z : measurements_) first_.push_back(first_.back() + z.rows());
  residual_.resize(first_.back());
  for (std::size_t i = 0; i < measurements_.size(); ++i)
    residual_.segment(first_[i], measurements_[i].rows()) = measurements_[i].residual();
}

double Innovation::nisOf(std::size_t i) const {
  const Eigen::LLT<SmallMatrix> llt{SmallMatrix(S(i, i))};
  const SmallVector residual = residual_.segment(first_[i], measurements_[i].rows());
  if (llt.info() != Eigen::Success) return std::numeric_limits<double>::quiet_NaN();
  return residual.dot(SmallVector(llt.solve(residual)));
}

void Innovation::putFirst(const std::vector<bool>& chosen) {
  std::vector<LinearMeasurement> ordered;
  std::vector<Eigen::Index> from; // rows of S, in their new order
  ordered.reserve(chosen.size());
  from.reserve(column_.size());
  for (const bool first : {true, false}) {
    for (std::size_t i = 0; i < chosen.size(); ++i) {
      if (chosen[i] != first) continue;
      for (Eigen::Index row = first_[i]; row < first_[i + 1]; ++row) from.push_back(row);
      ordered.push_back(std::move(measurements_[i]));
    }
    if (first) used_ = ordered.size();
  }
  measurements_ = std::move(ordered);
  stack();
  if (used_ == chosen.size()) return;
  for (Eigen::Index& column : column_) column = from[static_cast<std::size_t>(column)];
  // Those that take part in their place: whoever moves, moves to the left and upwards. The others behind
  // them.
  const Eigen::Index taking = rows(), all = first_.back();
  const auto rowFrom = [&from](Eigen::Index row) { return from[static_cast<std::size_t>(row)]; };
  Eigen::MatrixXd behind(all - taking, all);
  for (std::size_t k = used_; k < measurements_.size(); ++k) {
    for (Eigen::Index j = 0; j < first_[k + 1]; ++j) {
      for (Eigen::Index i = first_[k]; i < first_[k + 1]; ++i)
        behind(i - taking, j) = S_(std::max(rowFrom(i), rowFrom(j)), std::min(rowFrom(i), rowFrom(j)));
    }
  }
  for (std::size_t k = 0; k < used_; ++k) {
    for (Eigen::Index j = first_[k]; j < first_[k + 1]; ++j) {
      for (Eigen::Index i = first_[k]; i < taking; ++i) S_(i, j) = S_(rowFrom(i), rowFrom(j));
    }
  }
  S_.bottomRows(all - taking) = behind;
}

void Innovation::drop() {
  measurements_.erase(measurements_.begin() + static_cast<std::ptrdiff_t>(used_), measurements_.end());
  stack();
}

bool Innovation::factorise() {
  const Eigen::Index r = rows(), waiting = first_.back() - r;
  variance_ = S_.diagonal();
  auto S = S_.topLeftCorner(r, r);
  if (Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>>(S).info() != Eigen::Success) return false; // in its place
  white_ = residual();
  L().triangularView<Eigen::Lower>().solveInPlace(white_);
  if (waiting > 0) {
    auto behind = S_.block(r, 0, waiting, r);
    divideByLowerTransposed(behind, L());
    S_.block(r, r, waiting, waiting).triangularView<Eigen::Lower>() -= behind * behind.transpose();
    residual_.tail(waiting).noalias() -= behind * white_;
  }
  return solve();
}

bool Innovation::solve() {
  nis_ = white_.squaredNorm();
  Eigen::VectorXd weighted = white_;
  L().transpose().triangularView<Eigen::Upper>().solveInPlace(weighted);
  Eigen::VectorXd scattered = Eigen::VectorXd::Zero(PHt_.cols());
  for (Eigen::Index row = 0; row < rows(); ++row)
    scattered[column_[static_cast<std::size_t>(row)]] = weighted[row];
  error_.noalias() = PHt_ * scattered;
  return nis_ >= 0.0 && error_.allFinite();
}

/// Column by column, of which each is small: three rows of all columns lie far apart.
void Innovation::applyH(const Eigen::Ref<const Eigen::MatrixXd>& X, Eigen::Ref<Eigen::MatrixXd> HX) const {
  HX.setZero();
  const auto blocks = blocksOf(measurements_, used_, [&](std::size_t i, const auto& term) {
    HX.middleRows(first_[i], term.H.rows()).noalias() += term.H * X.middleRows(term.column, term.H.cols());
  });
  for (Eigen::Index column = 0; column < X.cols(); ++column) {
    for (const Block& block : blocks)
      HX.col(column).segment<3>(block.row) += block.H.times(X.col(column).segment<3>(block.column));
  }
}

Eigen::MatrixXd Innovation::PHt() const {
  Eigen::MatrixXd result(PHt_.rows(), rows());
  for (Eigen::Index row = 0; row < rows(); ++row)
    result.col(row) = PHt_.col(column_[static_cast<std::size_t>(row)]);
  return result;
}

Eigen::MatrixXd Innovation::PHt(const std::vector<Eigen::Index>& chosen) const {
  Eigen::MatrixXd result(static_cast<Eigen::Index>(chosen.size()), rows());
  for (Eigen::Index column = 0; column < rows(); ++column) {
    const auto from = PHt_.col(column_[static_cast<std::size_t>(column)]);
    for (std::size_t i = 0; i < chosen.size(); ++i)
      result(static_cast<Eigen::Index>(i), column) = from[chosen[i]];
  }
  return result;
}

/// The rows behind the factor are its own already, but for the blocks between themselves.
bool Innovation::accept(const std::vector<bool>& passes) {
  const Eigen::Index begin = rows();
  std::vector<Eigen::Index> from; // rows of those that pass
  for (std::size_t i = 0; i < passes.size(); ++i) {
    const std::size_t waiting = measurements_.size() - passes.size() + i;
    if (!passes[i]) continue;
    for (Eigen::Index row = first_[waiting]; row < first_[waiting + 1]; ++row) from.push_back(row);
    if (waiting != used_) measurements_[used_] = std::move(measurements_[waiting]);
    ++used_;
  }
  Eigen::VectorXd given_others(static_cast<Eigen::Index>(from.size()));
  for (std::size_t i = 0; i < from.size(); ++i)
    given_others[static_cast<Eigen::Index>(i)] = residual_[from[i]];
  drop();
  if (from.empty()) return true;
  const auto added = static_cast<Eigen::Index>(from.size());
  Eigen::MatrixXd S(added, begin + added);
  for (Eigen::Index i = 0; i < added; ++i) {
    const auto row = from[static_cast<std::size_t>(i)], to = begin + i;
    S.row(i).head(begin) = S_.row(row).head(begin);
    for (Eigen::Index j = 0; j <= i; ++j) S(i, begin + j) = S_(row, from[static_cast<std::size_t>(j)]);
    column_[static_cast<std::size_t>(to)] = column_[static_cast<std::size_t>(row)];
    variance_[to] = variance_[row];
  }
  Eigen::Ref<Eigen::MatrixXd> own = S.rightCols(added);
  if (Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>>(own).info() != Eigen::Success) return false;
  S_.block(begin, 0, added, begin + added) = S;
  own.triangularView<Eigen::Lower>().solveInPlace(given_others);
  white_.conservativeResize(begin + added);
  white_.tail(added) = given_others;
  return solve();
}

} // namespace vi_ekf_slam
