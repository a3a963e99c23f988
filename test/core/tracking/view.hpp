#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "../covariances.hpp"
#include "../numeric.hpp"
#include "../street.hpp"
#include "vi_ekf_slam/core/motion/constant_twist.hpp"
#include "vi_ekf_slam/core/tracking/frame_update.hpp"

/// Landmarks in view of a pair, to be corrected by a frame.
namespace vi_ekf_slam::test {

/// The landmarks, ids 0 and on, are known from the pixels of one frame; since then the body has moved on by a
/// tenth of a second.
struct View {
  View(double pixel_sigma, unsigned seed, std::size_t landmarks)
      : motion(motionOptions()),
        model(exampleRig(), {pixel_sigma, 1.0, true, 0.5, 100.0}),
        filter(SE3(), 1e-6 * Matrix6d::Identity()),
        map({}) {
    motion.addTo(filter);
    filter.closeCore();
    Random random(seed);
    for (std::size_t id = 0; id < landmarks; ++id) {
      const Eigen::Vector3d q(random.uniform(-4.0, 4.0), random.uniform(-1.0, 2.0),
                              random.uniform(6.0, 12.0));
      const auto seen = model.triangulate(filter, model.rig().camera.project(q));
      const Handle variable = filter.augment(Chart::kPoint, seen->position, seen->noise, seen->by);
      map.add({id, variable, 1, 0, 0, false});
    }
    motion.propagate(filter, 0.1);
    filter.settle();
  }

  static ConstantTwist::Options motionOptions() {
    ConstantTwist::Options options;
    options.twist_density.setConstant(0.05);
    options.prior_twist_sigma << 0.1, 0.1, 0.1, 0.01, 0.01, 0.01;
    options.prior_bias_sigma.setConstant(1e-3);
    return options;
  }

  /// What `change(id, camera's point)` makes of the points that are expected.
  template <typename Change>
  StereoFrame frameOf(const Change& change) const {
    StereoFrame frame;
    for (const Landmark& l : map.active())
      frame.features.push_back(
          {l.id, change(l.id, model.camTWorld(filter) * filter.variables().point(l.variable))});
    return frame;
  }

  /// The filter alone changes.
  FrameOutcome apply(const FrameUpdate::Options& options, const StereoFrame& frame) {
    std::vector<std::size_t> all(frame.features.size());
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
    Associations seen = associate(filter, map, model, frame, all);
    EXPECT_EQ(seen.known.size(), frame.features.size());
    return FrameUpdate(options, model, motion).apply(filter, std::move(seen.measurements));
  }

  ConstantTwist motion;
  StereoModel model;
  Filter filter;
  LandmarkMap map;
};

inline std::ptrdiff_t usedOf(const FrameOutcome& outcome) {
  return std::count(outcome.used.begin(), outcome.used.end(), true);
}

} // namespace vi_ekf_slam::test
