#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "street.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

/// Drives for SlamSystem, and what it tells its listeners.
namespace vi_ekf_slam::test {

constexpr auto kGyro = static_cast<std::size_t>(Stream::kImu);
constexpr auto kVelocity = static_cast<std::size_t>(Stream::kVelocity);
constexpr auto kStereo = static_cast<std::size_t>(Stream::kStereo);

Config makeConfig(PaperMode mode);

ImuSample gyro(double t);
VelocitySample velocity(double t);

/// A drive in the order of its stamps: gyro at 100 Hz, velocity at 50 Hz, stereo at 10 Hz.
std::vector<Measurement> drive(double start, double duration);

std::uint64_t total(const std::array<std::uint64_t, kStreamCount>& counts);

/// Everything that a SlamSystem told its listeners.
struct Record {
  std::vector<std::string> events; ///< "gyro <stamp>", "frame <stamp>", "reset"
  std::vector<std::string> reasons;
  std::vector<Output> outputs;

  void listenTo(SlamSystem& system) {
    system.onImu([this](const Output& output) { add("gyro ", output); });
    system.onFrame([this](const Output& output) { add("frame ", output); });
    system.onReset([this](const std::string& reason, const PathEstimate&) {
      events.emplace_back("reset");
      reasons.push_back(reason);
    });
  }

 private:
  void add(const std::string& kind, const Output& output) {
    events.push_back(kind + std::to_string(output.state.stamp));
    outputs.push_back(output);
  }
};

void expectSame(const Record& a, const Record& b);

/// The record of the measurements given in this order.
Record run(const std::vector<Measurement>& measurements);

} // namespace vi_ekf_slam::test
