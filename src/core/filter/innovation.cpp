#include "vi_ekf_slam/core/filter/innovation.hpp"

#include <Eigen/Cholesky>
#include <utility>

namespace vi_ekf_slam {

Innovation::Innovation(const Eigen::Ref<const Eigen::MatrixXd>& P,
                       std::vector<LinearMeasurement> measurements)
    : measurements_(std::move(measurements)) {
  stack();
  PHt_.resize(P.rows(), rows());
  for (std::size_t i = 0; i < measurements_.size(); ++i) {
    const LinearMeasurement& z = measurements_[i];
    auto columns = PHt_.middleCols(first_[i], z.rows());
    bool begun = false;
    for (const LinearMeasurement::Term& term : z) {
      if (term.H.rows() == 3 && term.H.cols() == 3) {
        const Eigen::Matrix3d Ht = term.H.transpose();
        auto three = PHt_.middleCols<3>(first_[i]);
        if (begun)
          three.noalias() += P.middleCols<3>(term.column).lazyProduct(Ht);
        else
          three.noalias() = P.middleCols<3>(term.column).lazyProduct(Ht);
      } else if (begun) {
        columns.noalias() += P.middleCols(term.column, term.H.cols()) * term.H.transpose();
      } else {
        columns.noalias() = P.middleCols(term.column, term.H.cols()) * term.H.transpose();
      }
      begun = true;
    }
    if (!begun) columns.setZero();
  }
  S_.resize(rows(), rows());
  for (std::size_t i = 0; i < measurements_.size(); ++i) {
    const LinearMeasurement& z = measurements_[i];
    auto left = S_.block(first_[i], 0, z.rows(), first_[i + 1]);
    left.setZero();
    z.addProduct(PHt_.leftCols(first_[i + 1]), left);
    S_.block(first_[i], first_[i], z.rows(), z.rows()) += z.noise();
  }
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
  const SmallVector& residual = measurements_[i].residual();
  if (llt.info() != Eigen::Success) return std::numeric_limits<double>::quiet_NaN();
  return residual.dot(SmallVector(llt.solve(residual)));
}

void Innovation::keep(const std::vector<bool>& chosen) {
  std::vector<LinearMeasurement> kept;
  std::vector<Eigen::Index> from;
  for (std::size_t i = 0; i < measurements_.size(); ++i) {
    if (!chosen[i]) continue;
    kept.push_back(measurements_[i]);
    from.push_back(first_[i]);
  }
  if (kept.size() == measurements_.size()) return;
  measurements_ = std::move(kept);
  stack();
  // In their place: whoever moves, moves to the left and upwards.
  for (std::size_t j = 0; j < from.size(); ++j) {
    const Eigen::Index columns = measurements_[j].rows();
    if (first_[j] != from[j]) PHt_.middleCols(first_[j], columns) = PHt_.middleCols(from[j], columns).eval();
    for (std::size_t i = j; i < from.size(); ++i) {
      const SmallMatrix block = S_.block(from[i], from[j], measurements_[i].rows(), columns);
      S_.block(first_[i], first_[j], measurements_[i].rows(), columns) = block;
    }
  }
  PHt_.conservativeResize(Eigen::NoChange, rows());
  S_.conservativeResize(rows(), rows());
}

bool Innovation::factorise() {
  if (Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>>(S_).info() != Eigen::Success) return false; // in its place
  Eigen::VectorXd weighted = residual_;
  S_.triangularView<Eigen::Lower>().solveInPlace(weighted);
  nis_ = weighted.squaredNorm();
  S_.transpose().triangularView<Eigen::Upper>().solveInPlace(weighted);
  error_.noalias() = PHt_ * weighted;
  return nis_ >= 0.0 && error_.allFinite();
}

} // namespace vi_ekf_slam
