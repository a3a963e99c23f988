/// Any bytes as a bag: refused with a BagError, or read.
#include <sys/mman.h>
#include <unistd.h>

#include <string>

#include "bag_input.hpp"
#include "system_checks.hpp"

namespace vi_ekf_slam::fuzz {
namespace {

InputTopics absoluteTopics() {
  return {"/imu", "/velocity", "/features", "/left/camera_info", "/right/camera_info"};
}

void check(const std::string& path) {
  SlamSystem system({});
  watch(system);
  try {
    BagInput input(path, absoluteTopics());
    Intake intake(system, {}, absoluteTopics());
    std::size_t messages = 0;
    input.feed(intake, [&messages](double share) {
      require(share > 0.0 && share <= 1.0, "progress is a share");
      return ++messages < 1000;
    });
  } catch (const BagError& error) {
    require(*error.what() != '\0', "a refusal says why");
  }
  system.flush();
}

} // namespace
} // namespace vi_ekf_slam::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const int file = memfd_create("bag", 0);
  if (file < 0 || write(file, data, size) != static_cast<ssize_t>(size)) return 0;
  vi_ekf_slam::fuzz::check("/proc/self/fd/" + std::to_string(file));
  close(file);
  return 0;
}
