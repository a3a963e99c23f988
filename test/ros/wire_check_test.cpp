#include "vi_ekf_slam/ros/wire_check.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace vi_ekf_slam::wire {
namespace {

/// Bytes of a message as older bags hold it, written field by field.
class Bytes {
 public:
  template <typename T>
  Bytes& add(const T& value) {
    std::vector<std::uint8_t> more(ros::serialization::serializationLength(value));
    ros::serialization::OStream stream(more.data(), static_cast<std::uint32_t>(more.size()));
    stream.next(value);
    bytes_.insert(bytes_.end(), more.begin(), more.end());
    return *this;
  }

  StereoFeatureArray readAs(const std::string& md5) const {
    const BagConnection connection{"features", "vi_ekf_slam/StereoFeatureArray", md5};
    return read<StereoFeatureArray>(
        BagMessage{connection, bytes_.data(), static_cast<std::uint32_t>(bytes_.size()), 0});
  }

 private:
  std::vector<std::uint8_t> bytes_;
};

std_msgs::Header header() {
  std_msgs::Header h;
  h.stamp = ros::Time(5, 7);
  h.frame_id = "left";
  return h;
}

/// What every feature has had.
Bytes& addPixels(Bytes& bytes, std::uint64_t id) {
  return bytes.add(id).add(10.5).add(20.25).add(5.0).add(20.5);
}

void expectPixels(const StereoFeature& f, std::uint64_t id) {
  EXPECT_EQ(f.id, id);
  EXPECT_EQ((std::vector<double>{f.u_left, f.v_left, f.u_right, f.v_right}),
            (std::vector<double>{10.5, 20.25, 5.0, 20.5}));
  EXPECT_EQ(f.walk, 0.0F);
}

TEST(OlderFeatures, of_five_numbers_are_read) {
  Bytes bytes;
  bytes.add(header()).add(std::uint32_t{2});
  addPixels(bytes, 3);
  addPixels(bytes, 4);
  const StereoFeatureArray read = bytes.readAs(kPlainFeatures);
  EXPECT_EQ(read.header.stamp, ros::Time(5, 7));
  ASSERT_EQ(read.features.size(), 2u);
  expectPixels(read.features[0], 3);
  expectPixels(read.features[1], 4);
  EXPECT_EQ(read.features[1].sigma, 0.0F);
}

TEST(OlderFeatures, without_a_walk_are_read) {
  const std::vector<std::uint8_t> descriptor(32, 7);
  Bytes bytes;
  bytes.add(header()).add(std::uint32_t{2});
  addPixels(bytes, 3).add(0.5F).add(descriptor);
  addPixels(bytes, 4).add(0.25F).add(std::vector<std::uint8_t>());
  const StereoFeatureArray read = bytes.readAs(kFeaturesWithoutWalk);
  ASSERT_EQ(read.features.size(), 2u);
  expectPixels(read.features[0], 3);
  expectPixels(read.features[1], 4);
  EXPECT_EQ(read.features[0].sigma, 0.5F);
  EXPECT_EQ(read.features[0].descriptor, descriptor);
  EXPECT_EQ(read.features[1].sigma, 0.25F);
  EXPECT_TRUE(read.features[1].descriptor.empty());
}

TEST(OlderFeatures, that_claim_more_than_they_hold_are_refused) {
  for (const char* md5 : {kPlainFeatures, kFeaturesWithoutWalk}) {
    Bytes bytes;
    bytes.add(header()).add(std::uint32_t{1000000000});
    addPixels(bytes, 3);
    EXPECT_ANY_THROW(bytes.readAs(md5)) << md5;
  }
}

TEST(OlderFeatures, of_another_definition_are_refused) {
  EXPECT_THROW(Bytes().readAs("00000000000000000000000000000000"), BagError);
}

} // namespace
} // namespace vi_ekf_slam::wire
