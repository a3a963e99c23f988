#include <gtest/gtest.h>

#include <random>

#include "vi_ekf_slam/core/loops/appearance_index.hpp"
#include "vi_ekf_slam/core/map/descriptor_set.hpp"

namespace vi_ekf_slam::test {
namespace {

class Bits {
 public:
  Descriptor random() {
    Descriptor d;
    for (auto& byte : d) byte = static_cast<std::uint8_t>(engine_());
    return d;
  }
  /// Another one that differs in `count` bits.
  Descriptor changed(Descriptor d, int count) {
    std::array<int, 256> order{};
    for (int i = 0; i < 256; ++i) order[static_cast<std::size_t>(i)] = i;
    std::shuffle(order.begin(), order.end(), engine_);
    for (int i = 0; i < count; ++i) {
      const auto bit = static_cast<std::size_t>(order[static_cast<std::size_t>(i)]);
      d[bit / 8] = static_cast<std::uint8_t>(d[bit / 8] ^ 1u << bit % 8);
    }
    return d;
  }

 private:
  std::mt19937 engine_{1};
};

DescriptorSet setOf(const Descriptor& d) {
  DescriptorSet set;
  set.add(d);
  return set;
}

TEST(Descriptors, DifferByTheBitsThatWereChanged) {
  Bits bits;
  const Descriptor d = bits.random();
  for (const int count : {0, 1, 31, 128, 256}) EXPECT_EQ(hammingDistance(d, bits.changed(d, count)), count);
}

TEST(DescriptorSet, KeepsOneOfEachView) {
  Bits bits;
  const Descriptor d = bits.random();
  DescriptorSet set;
  EXPECT_TRUE(set.isEmpty());
  for (int i = 0; i < 20; ++i) set.add(bits.changed(d, 10));
  EXPECT_EQ(set.size(), 1u);
  set.add(bits.changed(d, 100));
  EXPECT_EQ(set.size(), 2u);
}

TEST(DescriptorSet, KeepsTheViewsThatWereSeenMost) {
  Bits bits;
  DescriptorSet set;
  std::vector<Descriptor> views;
  for (std::size_t i = 0; i < DescriptorSet::kMost; ++i) {
    views.push_back(bits.random());
    for (int times = 0; times < 3; ++times) set.add(views.back());
  }
  for (int i = 0; i < 10; ++i) set.add(bits.random()); // each seen once: they take one place from each other
  EXPECT_EQ(set.size(), DescriptorSet::kMost);
  int kept = 0;
  for (const Descriptor& view : views) kept += distance(setOf(view), set) == 0 ? 1 : 0;
  EXPECT_GE(kept, static_cast<int>(DescriptorSet::kMost) - 1);
}

TEST(DescriptorSet, IsAsFarFromAnotherAsTheNearestOfBoth) {
  Bits bits;
  const Descriptor d = bits.random();
  DescriptorSet a = setOf(bits.random()), b = setOf(bits.random());
  a.add(d);
  b.add(bits.changed(d, 7));
  EXPECT_EQ(distance(a, b), 7);
  EXPECT_EQ(distance(a, DescriptorSet()), 256);
}

class AppearanceIndexTest : public ::testing::Test {
 protected:
  KnownLook look(FeatureId id, const Descriptor& d, double x) {
    return {id, {x, 0.0, 0.0}, 0.01 * Eigen::Matrix3d::Identity(), setOf(d)};
  }
  static bool all(const KnownLook& /*known*/) { return true; }
  Bits bits_;
};

TEST_F(AppearanceIndexTest, FindsEachOfTenThousandAgain) {
  std::vector<KnownLook> known;
  for (FeatureId id = 0; id < 10000; ++id) known.push_back(look(id, bits_.random(), static_cast<double>(id)));
  const AppearanceIndex index(known);
  for (std::size_t i = 0; i < known.size(); i += 100) {
    const auto found = index.find(setOf(bits_.changed(known[i].descriptors[0], 50)), all);
    ASSERT_TRUE(found) << i;
    EXPECT_EQ(*found, i);
  }
}

TEST_F(AppearanceIndexTest, FindsNothingLikeWhatIsNotThere) {
  std::vector<KnownLook> known;
  for (FeatureId id = 0; id < 1000; ++id) known.push_back(look(id, bits_.random(), static_cast<double>(id)));
  const AppearanceIndex index(known);
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(index.find(setOf(bits_.random()), all));
}

TEST_F(AppearanceIndexTest, DoesNotChooseBetweenTwoThatLookAlike) {
  const Descriptor d = bits_.random();
  const AppearanceIndex index({look(1, bits_.changed(d, 20), 0.0), look(2, bits_.changed(d, 22), 40.0)});
  EXPECT_FALSE(index.find(setOf(d), all));
  // Unless one is out of reach, or both are one point.
  const auto near = index.find(setOf(d), [](const KnownLook& known) { return known.position.x() > 1.0; });
  ASSERT_TRUE(near);
  EXPECT_EQ(index[*near].id, 2u);
  const AppearanceIndex twice({look(1, bits_.changed(d, 20), 0.0), look(2, bits_.changed(d, 22), 0.1)});
  ASSERT_TRUE(twice.find(setOf(d), all));
  EXPECT_EQ(twice[*twice.find(setOf(d), all)].id, 1u);
}

} // namespace
} // namespace vi_ekf_slam::test
