#include "vi_ekf_slam/core/paper/paper_estimator.hpp"
#include "vi_ekf_slam/core/run/config.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"
#include "vi_ekf_slam/core/slam/invariant_estimator.hpp"

namespace vi_ekf_slam {

std::unique_ptr<Estimator> makeEstimator(const Config& config) {
  if (config.estimator == EstimatorType::kInvariant) {
    return std::make_unique<InvariantEstimator>(config.invariant);
  }
  return std::make_unique<paper::PaperEstimator>(config.paper);
}

Gates gatesOf(const InvariantConfig& config) { return {config.update.gate, config.update.frame_gate}; }

void setGates(InvariantConfig& config, const Gates& gates) {
  config.update.gate = gates.gate;
  config.update.frame_gate = gates.frame_gate;
}

} // namespace vi_ekf_slam
