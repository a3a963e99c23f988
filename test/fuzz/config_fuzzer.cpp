/// Any text as a configuration: refused with one clear ConfigError, or read to values that the estimator
/// takes.
#include <memory>
#include <string>

#include "system_checks.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam::fuzz {
namespace {

void check(const std::string& yaml) {
  FullConfig config;
  try {
    config = parseFullConfig(yaml, "fuzz.yaml");
  } catch (const ConfigError& error) {
    const std::string what = error.what();
    require(what.rfind("fuzz.yaml: ", 0) == 0, "a refusal names the file");
    require(what.size() < 4000, "a refusal is short");
    return;
  }
  require(config.core.buffer.max_delay_s > 0.0 && config.core.buffer.max_delay_s <= 60.0,
          "values are in their ranges");
  require(config.ros.path_period_s >= 0.0, "values are in their ranges");
  require(!config.ros.map_frame.empty() && config.ros.map_frame != config.ros.odom_frame,
          "frames have names");
  SlamSystem system(config.core);
  watch(system);
  for (int i = 0; i < 3; ++i) {
    system.add(ImuSample{fromSeconds(1e9 + 0.1 * i), {0.0, 0.0, 0.1}, {}});
    system.add(VelocitySample{fromSeconds(1e9 + 0.1 * i), {1.0, 0.0, 0.0}, {}});
    system.add(StereoFrame{fromSeconds(1e9 + 0.1 * i), {}});
  }
  system.flush();
}

} // namespace
} // namespace vi_ekf_slam::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  vi_ekf_slam::fuzz::check(std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}
