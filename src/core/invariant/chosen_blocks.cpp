#include "vi_ekf_slam/core/invariant/chosen_blocks.hpp"

#include "vi_ekf_slam/core/invariant/landmark.hpp"

namespace vi_ekf_slam::invariant {

void keepChosen(const PooledVector<bool>& chosen, PooledMatrix& PHt, PooledMatrix& S,
                Pooled<Eigen::VectorXd>& innovation) {
  PooledVector<Eigen::Index> from; // first of three rows
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    if (chosen[i]) from.push_back(rowsOf(i));
  }
  if (from.size() == chosen.size()) return;
  const Eigen::Index rows = rowsOf(from.size());
  PooledMatrix chosen_PHt(PHt.rows(), rows), chosen_S(rows, rows);
  Pooled<Eigen::VectorXd> chosen_innovation(rows, 1);
  for (std::size_t j = 0; j < from.size(); ++j) {
    chosen_innovation.segment<3>(rowsOf(j)) = innovation.segment<3>(from[j]);
    chosen_PHt.middleCols<3>(rowsOf(j)) = PHt.middleCols<3>(from[j]);
    for (std::size_t i = j; i < from.size(); ++i)
      chosen_S.block<3, 3>(rowsOf(i), rowsOf(j)) = S.block<3, 3>(from[i], from[j]);
  }
  PHt.swap(chosen_PHt);
  S.swap(chosen_S);
  innovation.swap(chosen_innovation);
}

} // namespace vi_ekf_slam::invariant
