// When what is deferred for the inactive variables is settled, beside the frames.

#include "vi_ekf_slam/core/loops/settling.hpp"

#include "../filter/states.hpp"

namespace vi_ekf_slam::test {
namespace {

/// Points leave until this many blocks wait.
void defer(Scene& scene, Random& random, std::size_t blocks) {
  while (scene.filter.inactive().deferredBlocks() < blocks) {
    scene.filter.deactivate(scene.points.front());
    scene.points.erase(scene.points.begin());
    scene.addPoint(random);
  }
}

constexpr double kPerSecond = 1e6; // operations: beginning again waits for these, the thread is much faster

TEST(Settling, LetsALoopWaitUntilLittleIsDeferred) {
  Random random(1);
  Scene scene = busyScene(random, 8, 0.02);
  Settling settling(kPerSecond);
  EXPECT_TRUE(settling.isReady(scene.filter, 0)); // nothing is
  defer(scene, random, 6);
  EXPECT_TRUE(settling.isReady(scene.filter, 0));
  defer(scene, random, 12);
  EXPECT_FALSE(settling.isReady(scene.filter, 0));
  settling.advance(scene.filter, 0); // a thread may be ready by now, but that must make no difference
  EXPECT_FALSE(settling.isReady(scene.filter, 0));
  EXPECT_GE(scene.filter.inactive().deferredBlocks(), 12u);
  settling.advance(scene.filter, fromSeconds(1.0));
  EXPECT_EQ(scene.filter.inactive().deferredBlocks(), 0u);
  EXPECT_TRUE(settling.isReady(scene.filter, fromSeconds(1.0)));
  // Again, but not before the time for what was done has passed.
  defer(scene, random, 12);
  const Stamp next = fromSeconds(scene.filter.inactive().settlingCost() / kPerSecond);
  ASSERT_GT(next, fromSeconds(1.1));
  EXPECT_FALSE(settling.isReady(scene.filter, next - 2));
  settling.advance(scene.filter, next - 1);
  EXPECT_FALSE(settling.isReady(scene.filter, next - 1));
  EXPECT_EQ(scene.filter.inactive().deferredBlocks(), 12u);
  EXPECT_FALSE(settling.isReady(scene.filter, next + 1)); // begins
  settling.advance(scene.filter, next + fromSeconds(1.0));
  EXPECT_TRUE(settling.isReady(scene.filter, next + fromSeconds(1.0)));
}

} // namespace
} // namespace vi_ekf_slam::test
