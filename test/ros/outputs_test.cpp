#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <utility>

#include "vi_ekf_slam/ros/output/map_messages.hpp"
#include "vi_ekf_slam/ros/output/output_sequencer.hpp"
#include "vi_ekf_slam/ros/output/path_publisher.hpp"

namespace vi_ekf_slam {
namespace {

using visualization_msgs::Marker;

Output at(Stamp stamp) {
  Output o;
  o.state.stamp = stamp;
  return o;
}

class Sequencer : public testing::Test {
 protected:
  std::vector<std::pair<Stamp, bool>> sent_;
  OutputSequencer sequencer_{
      [this](const Output& o, bool is_frame) { sent_.emplace_back(o.state.stamp, is_frame); }};
};

TEST_F(Sequencer, a_frame_replaces_the_gyro_result_of_its_stamp) {
  sequencer_.add(at(1), false);
  sequencer_.add(at(1), true);
  sequencer_.endOfDrain();
  EXPECT_EQ((std::vector<std::pair<Stamp, bool>>{{1, true}}), sent_);
}

TEST_F(Sequencer, other_gyro_results_leave_in_order) {
  sequencer_.add(at(1), false);
  EXPECT_TRUE(sent_.empty());
  sequencer_.add(at(2), false);
  sequencer_.add(at(3), true);
  sequencer_.add(at(4), false);
  sequencer_.endOfDrain();
  sequencer_.endOfDrain();
  EXPECT_EQ((std::vector<std::pair<Stamp, bool>>{{1, false}, {2, false}, {3, true}, {4, false}}), sent_);
}

TEST_F(Sequencer, at_the_rate_of_frames_gyro_results_leave_only_while_no_frame_comes) {
  std::vector<std::pair<Stamp, bool>> sent;
  OutputSequencer sequencer(
      [&sent](const Output& o, bool is_frame) { sent.emplace_back(o.state.stamp / 100000000, is_frame); },
      OdometryRate::kFrame);
  const auto send = [&sequencer](std::initializer_list<int> tenths, bool is_frame) {
    for (const int tenth : tenths) {
      const Output output = at(tenth * Stamp{100000000});
      sequencer.add(output, is_frame);
      sequencer.endOfDrain();
    }
  };
  send({1000}, false); // no frame yet
  send({1001}, true);
  send({1002, 1011}, false);
  send({1012, 1013}, false); // the camera has stopped
  send({1014}, true);
  send({1015}, false);
  send({500}, false); // time went back
  using Sent = std::vector<std::pair<Stamp, bool>>;
  EXPECT_EQ((Sent{{1000, false}, {1001, true}, {1012, false}, {1013, false}, {1014, true}, {500, false}}),
            sent);
}

SE3 position(double x) { return {Eigen::Matrix3d::Identity(), {x, 0.0, 0.0}}; }

TEST(PathRecorder, keeps_points_a_distance_apart) {
  PathRecorder path("map", 100, 1.0);
  EXPECT_TRUE(path.add(1, position(0.0)));
  EXPECT_FALSE(path.add(2, position(0.9)));
  EXPECT_TRUE(path.add(3, position(1.1)));
  EXPECT_EQ(2U, path.message().poses.size());
  EXPECT_EQ(3U, path.message().header.stamp.toNSec());
}

TEST(PathRecorder, stays_capped_and_still_spans_the_whole_way) {
  PathRecorder path("map", 10, 1.0);
  for (int i = 0; i <= 1000; ++i) {
    path.add(i + 1, position(i));
    ASSERT_LE(path.message().poses.size(), 10U);
  }
  EXPECT_EQ(0.0, path.message().poses.front().pose.position.x);
  EXPECT_GT(path.message().poses.back().pose.position.x, 800.0);
  path.clear();
  path.add(1, position(0.0));
  EXPECT_TRUE(path.add(2, position(1.5))); // the configured distance holds again
}

std::vector<LandmarkEstimate> landmarks(std::size_t count) {
  std::vector<LandmarkEstimate> all(count);
  for (std::size_t i = 0; i < count; ++i) {
    all[i].id = (std::uint64_t{1} << 40U) + i;
    all[i].position = {static_cast<double>(i), 1.0, 2.0};
    all[i].covariance.setIdentity();
  }
  return all;
}

TEST(Markers, are_split_above_the_limit_of_rviz_and_surplus_ones_deleted) {
  const auto many = toMarkers(landmarks(kMaxPointsPerMarker + 5), 9, "map", 0);
  ASSERT_EQ(2U, many.markers.size());
  EXPECT_EQ(kMaxPointsPerMarker, many.markers[0].points.size());
  EXPECT_EQ(5U, many.markers[1].points.size());
  EXPECT_NE(many.markers[0].id, many.markers[1].id);
  const auto few = toMarkers(landmarks(3), 9, "map", 2);
  ASSERT_EQ(2U, few.markers.size());
  EXPECT_EQ(Marker::ADD, few.markers[0].action);
  EXPECT_EQ(Marker::DELETE, few.markers[1].action);
}

TEST(Markers, colour_is_logarithmic_in_how_well_a_landmark_is_known) {
  const std::pair<double, float> cases[] = {
      {0.0, 0.0F}, {0.01, 0.0F}, {0.1, 0.0F}, {std::sqrt(0.1), 0.25F},
      {1.0, 0.5F}, {10.0, 1.0F}, {1e3, 1.0F}}; // sigma in m, share of red
  for (const auto& [sigma, red] : cases) {
    auto all = landmarks(1);
    all[0].covariance *= sigma * sigma;
    const auto colour = toMarkers(all, 9, "map", 0).markers[0].colors[0];
    EXPECT_NEAR(red, colour.r, 1e-6) << sigma << " m";
    EXPECT_NEAR(1.0F - red, colour.g, 1e-6) << sigma << " m";
  }
}

TEST(Markers, of_loops_are_as_wide_as_their_path_is_long) {
  const auto width = [](double length) {
    PathEstimate path;
    path.nodes.resize(2);
    path.nodes[1].stamp = 1;
    path.nodes[1].now = SE3(Eigen::Matrix3d::Identity(), Eigen::Vector3d(0.0, length, 0.5 * length));
    path.loops = {{0, 1}};
    return loopMarker(path, 1, "map").scale.x;
  };
  EXPECT_NEAR(0.03, width(6.0), 1e-12);
  EXPECT_DOUBLE_EQ(0.3, width(300.0));
  EXPECT_GT(width(0.0), 0.0);
}

TEST(Cloud, carries_position_uncertainty_and_the_whole_id) {
  const auto cloud = toCloud(landmarks(2), 9, "map");
  ASSERT_EQ(2U, cloud.width);
  ASSERT_EQ(cloud.row_step, cloud.data.size());
  const auto field = [&](const std::string& name, std::size_t row, auto example) {
    for (const auto& f : cloud.fields) {
      if (f.name != name) continue;
      std::memcpy(&example, &cloud.data[row * cloud.point_step + f.offset], sizeof(example));
    }
    return example;
  };
  EXPECT_EQ(1.0F, field("x", 1, 0.0F));
  EXPECT_EQ(2.0F, field("z", 1, 0.0F));
  EXPECT_EQ(1.0F, field("sigma", 1, 0.0F));
  EXPECT_EQ(0.0F, field("log10_sigma", 1, 1.0F));
  EXPECT_EQ(1U, field("id", 1, 0U));
  EXPECT_EQ(1U << 8U, field("id_high", 1, 0U));
}

} // namespace
} // namespace vi_ekf_slam
