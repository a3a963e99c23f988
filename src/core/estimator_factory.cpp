#include "vi_ekf_slam/core/config.hpp"
#include "vi_ekf_slam/core/estimator.hpp"
#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"
#include "vi_ekf_slam/core/paper/paper_estimator.hpp"

namespace vi_ekf_slam {

std::unique_ptr<Estimator> makeEstimator(const Config& config) {
  if (config.estimator == EstimatorType::kInvariant) {
    return std::make_unique<invariant::InvariantEstimator>(config.invariant);
  }
  return std::make_unique<paper::PaperEstimator>(config.paper);
}

} // namespace vi_ekf_slam
