#include "vi_ekf_slam/core/invariant/chosen_blocks.hpp"

namespace vi_ekf_slam::invariant {

void keepChosen(const std::vector<bool>& chosen, Eigen::MatrixXd& PHt, Eigen::MatrixXd& S,
                Eigen::VectorXd& innovation) {
  // The chosen ones move to the front.
  Eigen::Index rows = 0;
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    if (!chosen[i]) continue;
    const auto from = 3 * static_cast<Eigen::Index>(i);
    if (from != rows) {
      innovation.segment<3>(rows) = innovation.segment<3>(from);
      PHt.middleCols<3>(rows) = PHt.middleCols<3>(from);
      S.middleCols<3>(rows) = S.middleCols<3>(from);
      S.middleRows<3>(rows) = S.middleRows<3>(from);
    }
    rows += 3;
  }
  innovation.conservativeResize(rows);
  PHt.conservativeResize(Eigen::NoChange, rows);
  S.conservativeResize(rows, rows);
}

} // namespace vi_ekf_slam::invariant
