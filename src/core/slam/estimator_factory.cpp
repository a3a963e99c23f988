#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"
#include "vi_ekf_slam/core/paper/paper_estimator.hpp"
#include "vi_ekf_slam/core/run/config.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"

namespace vi_ekf_slam {

std::unique_ptr<Estimator> makeEstimator(const Config& config) {
  if (config.estimator == EstimatorType::kInvariant) {
    return std::make_unique<invariant::InvariantEstimator>(config.invariant);
  }
  return std::make_unique<paper::PaperEstimator>(config.paper);
}

Gates gatesOf(const InvariantConfig& config) {
  return {config.gate, config.frame_gate, config.plausible_gate, config.motion_gate};
}

void setGates(InvariantConfig& config, const Gates& gates) {
  config.gate = gates.gate;
  config.frame_gate = gates.frame_gate;
  config.plausible_gate = gates.plausible_gate;
  config.motion_gate = gates.motion_gate;
}

} // namespace vi_ekf_slam
