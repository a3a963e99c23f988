#include "system_drive.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace vi_ekf_slam::test {

Config makeConfig(PaperMode mode) {
  Config config;
  config.estimator = EstimatorType::kPaper;
  config.paper = sharpConfig(mode);
  config.rig_wait_s = 2.0;
  config.buffer.max_delay_s = 0.2;
  config.buffer.max_jump_s = 1.0;
  config.buffer.jump_confirmations = 1; // a single measurement shows what a jump does
  return config;
}

ImuSample gyro(double t) { return {fromSeconds(t), {0.01, 0.02, 0.1}, {}}; }
VelocitySample velocity(double t) { return {fromSeconds(t), {2.0, 0.1, 0.0}, {}}; }

std::vector<Measurement> drive(double start, double duration) {
  Street street(1, 40);
  DeadReckoning truth;
  std::vector<Measurement> all;
  const int samples = static_cast<int>(std::lround(100.0 * duration));
  for (int i = 0; i < samples; ++i) {
    const double t = start + 0.01 * i;
    all.emplace_back(gyro(t));
    truth.process(gyro(t));
    if (i % 2 == 0) {
      all.emplace_back(velocity(t));
      truth.process(velocity(t));
    }
    if (i % 10 == 0) all.emplace_back(street.frame(fromSeconds(t), truth.pose(), 1.0));
  }
  return all;
}

std::uint64_t total(const std::array<std::uint64_t, kStreamCount>& counts) {
  std::uint64_t sum = 0;
  for (const auto count : counts) sum += count;
  return sum;
}

void expectSame(const Record& a, const Record& b) {
  ASSERT_EQ(a.events, b.events);
  for (std::size_t i = 0; i < a.outputs.size(); ++i) {
    const Output &x = a.outputs[i], &y = b.outputs[i];
    ASSERT_EQ(distance(x.state.world_T_imu.matrix(), y.state.world_T_imu.matrix()), 0.0) << a.events[i];
    ASSERT_EQ(distance(x.state.pose_covariance, y.state.pose_covariance), 0.0) << a.events[i];
    ASSERT_EQ(distance(x.odom_T_imu.matrix(), y.odom_T_imu.matrix()), 0.0) << a.events[i];
    ASSERT_EQ(x.report.used, y.report.used) << a.events[i];
  }
}

Record run(const std::vector<Measurement>& measurements) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  Record record;
  record.listenTo(system);
  system.setRig(exampleRig());
  for (const auto& m : measurements) system.add(m);
  system.flush();
  EXPECT_EQ(total(system.counts().processed), measurements.size());
  EXPECT_EQ(total(system.counts().late), 0U);
  return record;
}

} // namespace vi_ekf_slam::test
