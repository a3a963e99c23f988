#include "vi_ekf_slam/ros/output/output_sequencer.hpp"

namespace vi_ekf_slam {

void OutputSequencer::addGyro(const Output& output) {
  endOfDrain();
  held_ = output;
}

void OutputSequencer::addFrame(const Output& output) {
  if (held_ && held_->state.stamp == output.state.stamp) held_.reset();
  endOfDrain();
  sink_(output, true);
}

void OutputSequencer::endOfDrain() {
  if (!held_) return;
  const Output output = *held_;
  held_.reset();
  sink_(output, false);
}

} // namespace vi_ekf_slam
