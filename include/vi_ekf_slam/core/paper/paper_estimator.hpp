#pragma once

#include <optional>

#include "vi_ekf_slam/core/motion/dead_reckoning.hpp"
#include "vi_ekf_slam/core/paper/filters.hpp"
#include "vi_ekf_slam/core/slam/config.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"

namespace vi_ekf_slam::paper {

/// The paper's filter in its three modes behind the common interface.
class PaperEstimator : public Estimator {
 public:
  explicit PaperEstimator(const PaperConfig& config);

  void setRig(const StereoRig& rig) override { rig_ = rig; }
  void process(const ImuSample& sample) override;
  void process(const VelocitySample& sample) override;
  FrameReport process(const StereoFrame& frame) override;
  StateEstimate state() const override;
  std::vector<LandmarkEstimate> landmarks() const override;

 private:
  void predictTo(Stamp stamp);

  PaperConfig config_;
  DeadReckoning held_;    ///< the measured twist, each sample held until the next, and its clock
  LandmarkMapper mapper_; ///< in mode mapping
  JointEkf joint_;        ///< the pose, and in mode slam the landmarks
  std::optional<StereoRig> rig_;
};

} // namespace vi_ekf_slam::paper
