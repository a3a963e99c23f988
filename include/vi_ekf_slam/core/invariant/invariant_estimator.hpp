#pragma once

#include <deque>
#include <map>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/estimator.hpp"
#include "vi_ekf_slam/core/invariant/config.hpp"
#include "vi_ekf_slam/core/invariant/scale_monitor.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/invariant/stereo_update.hpp"

namespace vi_ekf_slam::invariant {

/// The right-invariant EKF with a twist state: gyro, velocity and stereo frames are measurements of one
/// state, each at its own rate. Landmarks leave the state with their tracks; the map keeps their last
/// estimate.
class InvariantEstimator : public Estimator {
 public:
  explicit InvariantEstimator(const InvariantConfig& config);

  void setRig(const StereoRig& rig) override;
  void process(const GyroSample& sample) override;
  void process(const VelocitySample& sample) override;
  FrameReport process(const StereoFrame& frame) override;
  StateEstimate state() const override;
  std::vector<LandmarkEstimate> landmarks() const override;

 private:
  void advanceTo(Stamp stamp);
  void measureTwist(Eigen::Index axis, const Eigen::Vector3d& measured, const Eigen::Matrix3d& noise);
  bool isUsable(const StereoPixels& pixels) const;
  std::vector<Observation> match(const StereoFrame& frame, const std::vector<std::size_t>& usable,
                                 std::vector<std::size_t>& unknown, std::vector<bool>& seen) const;
  std::vector<bool> update(const StereoFrame& frame, const std::vector<Observation>& observations,
                           FrameReport& report);
  bool updateWithConsensus(const std::vector<Observation>& observations, std::vector<bool>& used,
                           FrameReport& report);
  void rescue(const StereoFrame& frame, const std::vector<Observation>& observations, std::vector<bool>& used,
              FrameReport& report);
  void remove(const std::vector<bool>& keep, FrameReport& report);
  void initialise(const StereoFrame& frame, const std::vector<std::size_t>& features, FrameReport& report);
  LandmarkEstimate estimateOf(std::size_t landmark) const;
  void archive(const LandmarkEstimate& landmark);

  InvariantConfig config_;
  State state_;
  ScaleMonitor scale_;
  std::optional<StereoModel> model_;
  double baseline_ = 0.0; ///< m, as calibrated
  std::optional<Stamp> stamp_;
  std::size_t last_used_ = 0; ///< features used by the last frame
  std::map<FeatureId, LandmarkEstimate> archive_;
  std::deque<FeatureId> archive_order_;
};

} // namespace vi_ekf_slam::invariant
