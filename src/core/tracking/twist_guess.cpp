#include "vi_ekf_slam/core/tracking/twist_guess.hpp"

#include <cmath>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/motion/constant_twist.hpp"

namespace vi_ekf_slam {
namespace {

// m, standard deviation of the way to the frame: of points 6 m away it leaves half a pixel to what is not
// linear.
constexpr double kLinearWay = 0.2;
constexpr double kFound = 0.02; // m of way, by which a guess that is good enough differs from the one before
constexpr int kGuesses = 4;     // a guess is off by the square of what the one before was

} // namespace

void guessTwist(Filter& filter, const FrameUpdate& update, const LandmarkMap& map, const StereoFrame& frame,
                double seconds, const std::function<void(Filter&)>& ahead) {
  const auto known = filter.variables().find(ConstantTwist::kTwist);
  if (!known || map.active().empty()) return;
  const Eigen::VectorXd variances = filter.covariance(*known).diagonal();
  if (!(seconds * std::sqrt(variances.head<3>().maxCoeff()) > kLinearWay)) return;
  std::vector<std::size_t> usable;
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    if (update.model().isUsable(frame.features[i].pixels, frame.features[i].sigma)) usable.push_back(i);
  }
  for (int i = 0; i < kGuesses; ++i) {
    Filter there = filter;
    ahead(there);
    there.settle();
    Associations seen = associate(there, map, update.model(), frame, usable);
    if (seen.measurements.empty() || update.apply(there, std::move(seen.measurements)).skipped) return;
    const Vector6d told = there.variables().mean(*known), before = filter.variables().mean(*known);
    filter.setMean(*known, told);
    if (seconds * (told - before).head<3>().norm() < kFound) return;
  }
}

} // namespace vi_ekf_slam
