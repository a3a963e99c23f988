#pragma once

#include <Eigen/Core>
#include <random>
#include <unordered_map>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/motion/constant_twist.hpp"
#include "vi_ekf_slam/core/tracking/frame_update.hpp"

namespace vi_ekf_slam {

/// A body at rest before a stereo pair's points, and what of the estimator a frame passes through: all
/// landmarks in view are seen in every frame.
class RestingScene {
 public:
  RestingScene(std::size_t in_view, const LandmarkMap::Options& kept)
      : filter(SE3(), Vector6d::Constant(1e-6).asDiagonal()), map(kept) {
    motion.addTo(filter);
    filter.closeCore();
    for (FeatureId id = 0; id < in_view; ++id) initialise(see(id));
    for (int k = 0; k < 5; ++k) {
      advance();
      correct(look());
    }
  }

  void advance() {
    motion.propagate(filter, 0.1);
    filter.settle();
  }

  /// Feature i is landmark i's.
  StereoFrame look() {
    StereoFrame frame;
    for (const Landmark& landmark : map.active()) frame.features.push_back(see(landmark.id));
    return frame;
  }

  FrameOutcome correct(const StereoFrame& frame) { return correct(filter, frame); }
  /// A copy of the filter.
  FrameOutcome correct(Filter& copy, const StereoFrame& frame) const {
    std::vector<LinearMeasurement> all;
    for (std::size_t i = 0; i < map.active().size(); ++i)
      all.push_back(*model.observe(copy, map.active()[i].variable, frame.features[i].pixels));
    return update.apply(copy, std::move(all));
  }

  /// With noise; a point that was never seen comes into being.
  StereoFeatureObservation see(FeatureId id) {
    const auto [point, is_new] = points_.emplace(id, Eigen::Vector3d::Zero());
    if (is_new) point->second = depth_(engine_) * Eigen::Vector3d(x_(engine_), y_(engine_), 1.0);
    const StereoPixels noise(pixel_(engine_), pixel_(engine_), pixel_(engine_), pixel_(engine_));
    return {id, model.rig().camera.project(point->second) + noise};
  }

  void initialise(const StereoFeatureObservation& feature) {
    const auto seen = model.triangulate(filter, feature.pixels);
    const Handle variable = filter.augment(Chart::kPoint, seen->position, seen->noise, seen->by);
    map.add({feature.id, variable, 1, 0, 0, false});
  }

  const FrameUpdate::Options options;
  ConstantTwist motion{ConstantTwist::Options()};
  const StereoModel model{{{700.0, 700.0, 600.0, 180.0, 0.54}, SE3()}, StereoModel::Options()};
  const FrameUpdate update{options, model, motion};
  Filter filter;
  LandmarkMap map;

 private:
  std::mt19937 engine_{1};
  std::uniform_real_distribution<double> x_{-0.8, 0.8}, y_{-0.2, 0.2},
      depth_{6.0, 60.0}; // m at a depth of 1 m, m
  std::normal_distribution<double> pixel_{0.0, 0.3};
  std::unordered_map<FeatureId, Eigen::Vector3d> points_; ///< m, left camera
};

} // namespace vi_ekf_slam
