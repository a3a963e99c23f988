#include "vi_ekf_slam/ros/output/output_sequencer.hpp"

#include <cmath>

namespace vi_ekf_slam {
namespace {

constexpr double kFramesStopped = 1.0; // s

} // namespace

void OutputSequencer::add(const Output& output, bool is_frame) {
  if (is_frame && held_ && held_->state.stamp == output.state.stamp) held_.reset();
  endOfDrain();
  if (is_frame) {
    last_frame_ = output.state.stamp;
    return sink_(output, true);
  }
  // A stamp before that frame's is of a new start.
  const bool frames_come =
      last_frame_ && std::abs(secondsBetween(*last_frame_, output.state.stamp)) <= kFramesStopped;
  if (rate_ == OdometryRate::kImu || !frames_come) held_ = output;
}

void OutputSequencer::endOfDrain() {
  if (!held_) return;
  const Output output = *held_;
  held_.reset();
  sink_(output, false);
}

} // namespace vi_ekf_slam
