#include "vi_ekf_slam/ros/node/results.hpp"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

#include "folder.hpp"

namespace vi_ekf_slam {
namespace {

namespace fs = std::filesystem;

class ResultsFolder : public InFolder {
 protected:
  std::ptrdiff_t savedPoses() const {
    std::ifstream file(at("trajectory.tum"));
    return std::count(std::istreambuf_iterator<char>(file), {}, '\n');
  }
  template <typename Condition>
  static bool waitFor(const Condition& condition) {
    for (int i = 0; i < 1000 && !condition(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return condition();
  }
};

Output poseAt(double seconds) {
  Output output;
  output.state.stamp = output.report.stamp = fromSeconds(seconds);
  return output;
}

/// Whoever ends the node may kill it before a map is computed and written.
TEST_F(ResultsFolder, have_the_poses_of_the_end_while_a_map_is_written) {
  NodeSettings settings;
  settings.autosave_period_s = 1e-9;
  settings.maps = {directory_, "", true, "map"};
  MapStore maps(settings.maps);
  SlamSystem system(settings.config.core);
  for (const double t : {1.0, 1.1}) system.add(ImuSample{fromSeconds(t), Eigen::Vector3d::Zero(), {}});
  system.flush();
  ASSERT_TRUE(system.estimator().savedMap());
  Worker worker({0.3, 100});
  Results results(settings, maps, system, worker, [&] { return RunSummary(system); });

  std::promise<void> begun, goes_on;
  std::thread slow_disk([&] {
    maps.write(
        [&, map = system.estimator().savedMap()] {
          begun.set_value();
          goes_on.get_future().wait();
          return map();
        },
        at("other.bag"));
  });
  begun.get_future().wait();
  results.add(poseAt(1.0), true);
  results.autosaveIfDue();
  EXPECT_TRUE(waitFor([&] { return fs::exists(at("summary.yaml")); }));
  EXPECT_EQ(1, savedPoses());

  results.add(poseAt(2.0), true);
  std::thread end([&] { results.saveAtTheEnd(); });
  EXPECT_TRUE(waitFor([&] { return savedPoses() == 2; }));
  EXPECT_FALSE(fs::exists(at("map.bag")));
  goes_on.set_value();
  slow_disk.join();
  end.join();
  EXPECT_EQ("", results.failure());
  EXPECT_TRUE(fs::exists(at("map.bag")));
}

} // namespace
} // namespace vi_ekf_slam
