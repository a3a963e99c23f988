// Saved maps on the disk: honest ones, damaged ones, and ones made to harm.
#include "vi_ekf_slam/ros/map_file.hpp"

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <std_msgs/String.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>

#include "../core/numeric.hpp"
#include "folder.hpp"
#include "vi_ekf_slam/MapDescriptors.h"
#include "vi_ekf_slam/MapLandmark.h"
#include "vi_ekf_slam/MapState.h"
#include "vi_ekf_slam/ros/conversions.hpp"

/// MapState as it was in format 1, with no more than rosbag needs to write it.
struct Format1 {
  std::array<std::uint8_t, 16 + 8 * 7 + 8 * 12 + 4 + 8 * 171> bytes{};
};

namespace ros::message_traits {
template <>
struct DataType<Format1> {
  static const char* value() { return DataType<vi_ekf_slam::MapState>::value(); }
  static const char* value(const Format1& /*message*/) { return value(); }
};
template <>
struct MD5Sum<Format1> {
  static const char* value() { return "b8c6e3bae06010c0888cce2f96b7df60"; }
  static const char* value(const Format1& /*message*/) { return value(); }
};
template <>
struct Definition<Format1> {
  static const char* value() { return "float64[6] twist"; }
  static const char* value(const Format1& /*message*/) { return value(); }
};
} // namespace ros::message_traits

namespace ros::serialization {
template <>
struct Serializer<Format1> {
  static void write(OStream& stream, const Format1& message) {
    std::copy(message.bytes.begin(), message.bytes.end(), stream.advance(serializedLength(message)));
  }
  static std::uint32_t serializedLength(const Format1& message) {
    return static_cast<std::uint32_t>(message.bytes.size());
  }
};
} // namespace ros::serialization

namespace vi_ekf_slam {
namespace {

namespace fs = std::filesystem;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

SavedMap example(std::size_t landmarks = 5) {
  test::Random random(1);
  SavedMap map;
  map.stamp = fromSeconds(1000.5) + 7;
  map.world_T_imu = SE3::Exp(random.vector<6>(-2.0, 2.0));
  map.variables = {{"twist", random.vector<6>(-1.0, 1.0)},
                   {"scale", Eigen::VectorXd::Constant(1, 0.02)},
                   {"twist_bias", random.vector<6>(-0.01, 0.01)}};
  for (std::size_t i = 0; i < landmarks; ++i)
    map.landmarks.push_back({(FeatureId{1} << 63) + i, random.vector<3>(-90.0, 90.0), 3 + i});
  const Eigen::Index rows = map.rowOf(landmarks);
  Eigen::MatrixXd A(rows, rows);
  for (Eigen::Index i = 0; i < A.size(); ++i) A(i) = random.uniform(-1.0, 1.0);
  map.covariance = A * A.transpose();
  map.covariance.triangularView<Eigen::StrictlyUpper>() = map.covariance.transpose();
  return map;
}

class MapFile : public InFolder {
 protected:
  void SetUp() override {
    InFolder::SetUp();
    path_ = at("map.bag");
  }

  std::string bytes() const {
    std::ifstream file(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void put(const std::string& content) const { std::ofstream(path_, std::ios::binary) << content; }

  /// The messages of the example, spoiled, as a bag that nothing has checked.
  void putMessages(const std::function<void(MapState&, std::vector<MapLandmark>&)>& spoil,
                   rosbag::CompressionType compression = rosbag::compression::Uncompressed) const {
    writeMapFile(path_, example(), "map");
    MapState state;
    std::vector<MapLandmark> landmarks;
    {
      rosbag::Bag bag(path_);
      for (const auto& m : rosbag::View(bag, rosbag::TopicQuery("map"))) state = *m.instantiate<MapState>();
      for (const auto& m : rosbag::View(bag, rosbag::TopicQuery("landmarks")))
        landmarks.push_back(*m.instantiate<MapLandmark>());
    }
    spoil(state, landmarks);
    rosbag::Bag bag(path_, rosbag::bagmode::Write);
    bag.setCompression(compression);
    bag.write("map", ros::Time(1000, 0), state);
    for (std::size_t i = 0; i < landmarks.size(); ++i)
      bag.write("landmarks", ros::Time(1000, 1 + static_cast<std::uint32_t>(i)), landmarks[i]);
  }

  /// The refusal names the file and has all of `words`.
  void expectRefusal(const std::vector<std::string>& words) const {
    try {
      readMapFile(path_);
      ADD_FAILURE() << "accepted, which lacks: " << words.front();
    } catch (const MapError& e) {
      const std::string what = e.what();
      EXPECT_EQ(what.rfind(path_ + ": ", 0), 0U) << what;
      EXPECT_EQ(what.find('\n'), std::string::npos) << what;
      for (const std::string& word : words)
        EXPECT_NE(what.find(word), std::string::npos) << what << " lacks " << word;
    }
  }

  /// Of the map that is there, with another length at `offset` of where `around` is.
  void expectArrayRefused(const std::string& around, std::size_t offset) const {
    const std::string whole = bytes();
    std::string content = whole;
    const std::size_t at = content.find(around);
    ASSERT_NE(at, std::string::npos);
    content.replace(at + offset, 4, "\xff\xff\xff\xff", 4);
    put(content);
    expectRefusal({"announces more elements than it holds"});
    put(whole);
  }

  std::string path_;
};

TEST_F(MapFile, ReadsBackToTheLastBit) {
  for (const std::size_t landmarks : {0U, 1U, 40U}) {
    const SavedMap map = example(landmarks);
    writeMapFile(path_, map, "map");
    const SavedMap read = readMapFile(path_);
    EXPECT_EQ(read.stamp, map.stamp);
    EXPECT_LT(test::distance(read.world_T_imu.matrix(), map.world_T_imu.matrix()), 1e-15);
    ASSERT_EQ(read.variables.size(), map.variables.size());
    for (std::size_t i = 0; i < map.variables.size(); ++i) {
      EXPECT_EQ(read.variables[i].name, map.variables[i].name);
      EXPECT_EQ(read.variables[i].mean, map.variables[i].mean);
    }
    EXPECT_EQ(read.covariance, map.covariance);
    ASSERT_EQ(read.landmarks.size(), landmarks);
    for (std::size_t i = 0; i < landmarks; ++i) {
      EXPECT_EQ(read.landmarks[i].id, map.landmarks[i].id);
      EXPECT_EQ(read.landmarks[i].position, map.landmarks[i].position);
      EXPECT_EQ(read.landmarks[i].observations, map.landmarks[i].observations);
    }
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(directory_), fs::directory_iterator()), 1)
      << "only the map is left";
}

TEST_F(MapFile, AMapThatIsNoneIsNotWrittenOverOneThatIs) {
  writeMapFile(path_, example(), "map");
  const std::string before = bytes();
  SavedMap broken = example();
  broken.covariance(2, 2) = kNaN;
  EXPECT_THROW(writeMapFile(path_, broken, "map"), MapError);
  EXPECT_EQ(bytes(), before);
  EXPECT_EQ(std::distance(fs::directory_iterator(directory_), fs::directory_iterator()), 1);
  try {
    writeMapFile(directory_ + "/nowhere/map.bag", example(), "map");
    ADD_FAILURE() << "written nowhere";
  } catch (const MapError& e) {
    EXPECT_NE(std::string(e.what()).find("nowhere/map.bag: cannot be written"), std::string::npos)
        << e.what();
  }
}

TEST_F(MapFile, OnAFullDiskWhatWasThereStays) {
  writeMapFile(path_, example(), "map");
  const std::string before = bytes();
  const SavedMap large = example(120);
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const rlim_t room : {0U, 5000U, 100000U}) { // bytes: of the header, of the first message, of landmarks
    const rlimit little{room, limit.rlim_max};
    setrlimit(RLIMIT_FSIZE, &little);
    EXPECT_THROW(writeMapFile(path_, large, "map"), MapError) << room;
    setrlimit(RLIMIT_FSIZE, &limit);
    EXPECT_EQ(bytes(), before);
    EXPECT_EQ(std::distance(fs::directory_iterator(directory_), fs::directory_iterator()), 1);
  }
  std::signal(SIGXFSZ, handler);
}

TEST_F(MapFile, WhatIsNoBagIsRefused) {
  expectRefusal({"no such file"});
  for (const std::string& content : {std::string("\x1f\x8b\x08\0\0\0\0\0\0\x03", 10),
                                     std::string("PK\x03\x04"
                                                 "covariance.npy"),
                                     std::string("\x80\x04\x95\x1c\0\0\0\0\0\0\0\x8c\x05posix", 19),
                                     std::string("#ROSBAG V1.2\n"), std::string("id,x,y,z\n1,2,3,4\n")}) {
    put(content);
    expectRefusal({"is not a bag"});
  }
  put("");
  expectRefusal({"is empty"});
  fs::remove(path_);
  fs::create_directory(path_);
  expectRefusal({"is not a file"});
}

TEST_F(MapFile, WhatIsCutShortIsRefused) {
  writeMapFile(path_, example(), "map");
  const std::string whole = bytes();
  for (std::size_t length = 0; length < whole.size(); length += whole.size() / 97) {
    put(whole.substr(0, length));
    expectRefusal({""});
  }
  put(whole.substr(0, whole.size() - 1));
  expectRefusal({""});
}

TEST_F(MapFile, WhatIsWrongInAMessageIsNamed) {
  struct Case {
    std::function<void(MapState&, std::vector<MapLandmark>&)> spoil;
    std::vector<std::string> words;
  };
  using Landmarks = std::vector<MapLandmark>;
  const std::vector<Case> cases = {
      {[](MapState& s, Landmarks&) { s.pose.position.x = kNaN; }, {"pose.position[0]", "nan", "allowed"}},
      {[](MapState& s, Landmarks&) { s.pose.orientation.w = kNaN; }, {"pose.orientation", "nan", "norm 1"}},
      {[](MapState& s, Landmarks&) { s.pose.orientation = geometry_msgs::Quaternion(); },
       {"pose.orientation", "0.0"}},
      {[](MapState& s, Landmarks&) { s.header.stamp = ros::Time(); }, {"stamp", "allowed"}},
      {[](MapState& s, Landmarks&) { s.version = 3; }, {"version is 3", "allowed: 2"}},
      {[](MapState& s, Landmarks&) { s.version = 0; }, {"version is 0", "allowed: 2"}},
      {[](MapState& s, Landmarks&) { s.variables[0].mean[3] = 1e308; }, {"twist[3]", "1e+308", "allowed"}},
      {[](MapState& s, Landmarks&) { s.variables[0].name = "scale"; },
       {"variables[1].name", "scale", "every name once"}},
      {[](MapState& s, Landmarks&) { s.variables[2].name.assign(1 << 20, 'x'); },
       {"variables[2].name", "1048576", "1 to 32"}},
      {[](MapState& s, Landmarks&) { s.variables[2].name = "two\nlines"; }, {"variables[2].name", "a to z"}},
      {[](MapState& s, Landmarks&) { s.variables[1].mean.clear(); }, {"variables[1].mean", "0 numbers"}},
      {[](MapState& s, Landmarks&) { s.variables[1].mean.resize(1 << 20); },
       {"variables[1].mean", "1048576 numbers", "1 to 32"}},
      {[](MapState& s, Landmarks&) { s.variables[1].mean.resize(2); },
       {"covariance", "190 numbers", "210 numbers"}},
      {[](MapState& s, Landmarks&) { s.variables.resize(1 << 20); }, {"variables", "1048576", "at most 16"}},
      {[](MapState& s, Landmarks&) { s.variables.pop_back(); }, {"covariance", "190 numbers", "91 numbers"}},
      {[](MapState& s, Landmarks&) { s.covariance.clear(); }, {"covariance", "0 numbers", "190 numbers"}},
      {[](MapState& s, Landmarks&) { s.covariance[0] = -1.0; }, {"covariance[0][0]", "-1", "allowed"}},
      {[](MapState& s, Landmarks&) { s.landmarks = 4000000000U; },
       {"landmarks", "4000000000", "at most 4000"}},
      {[](MapState& s, Landmarks&) { s.landmarks = 4000; }, {"landmarks", "4000", "bytes"}},
      {[](MapState& s, Landmarks&) { s.landmarks = 6; }, {"5 messages", "6"}},
      {[](MapState& s, Landmarks&) { s.landmarks = 4; }, {"landmarks[4]", "the 4"}},
      {[](MapState&, Landmarks& l) { l[1].id = l[3].id; }, {"landmarks[3].id", "every id once"}},
      {[](MapState&, Landmarks& l) { l[2].position.y = -1e308; }, {"landmarks[2].position[1]", "-1e+308"}},
      {[](MapState&, Landmarks& l) { std::swap(l[1], l[2]); },
       {"landmarks[1].covariance", "81 numbers", "72 numbers"}},
      {[](MapState&, Landmarks& l) { l[0].covariance.clear(); }, {"landmarks[0].covariance", "0 numbers"}},
      {[](MapState&, Landmarks& l) { l[4].covariance.resize(1 << 20); },
       {"landmarks[4].covariance", "1048576 numbers"}},
      {[](MapState&, Landmarks& l) { l[0].covariance[5] = kNaN; }, {"covariance[19][5]", "nan"}},
      {[](MapState&, Landmarks& l) { l[0].covariance[19] = -0.5; }, {"covariance[19][19]", "-0.5"}},
      {[](MapState&, Landmarks& l) { l[4].covariance.back() *= 1e-3; }, {"covariance"}},
  };
  for (std::size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(i);
    putMessages(cases[i].spoil);
    expectRefusal(cases[i].words);
  }
  putMessages([](MapState&, Landmarks&) {});
  EXPECT_NO_THROW(readMapFile(path_));
}

TEST_F(MapFile, ASmallFileCannotAskForALargeMap) {
  // Half a gigabyte of zeros in a few kilobytes.
  putMessages(
      [](MapState& s, std::vector<MapLandmark>& l) {
        s.landmarks = 800;
        l.resize(800);
        for (std::size_t i = 0; i < l.size(); ++i) l[i].covariance.assign(3 * (19 + 3 * i) + 6, 0.0);
      },
      rosbag::compression::BZ2);
  EXPECT_LT(fs::file_size(path_), 1000000U);
  expectRefusal({"landmarks", "800", "compressed"});
}

TEST_F(MapFile, AnArrayThatIsLongerThanItsMessageIsRefused) {
  writeMapFile(path_, example(), "map");
  // The length of the first landmark's covariance, behind its number of observations.
  expectArrayRefused(std::string("\x03\0\0\0\x3f\0\0\0", 8), 4);
  // Those of the variables, behind the pose, and of one's mean, behind its name.
  expectArrayRefused(std::string("\x03\0\0\0\x05\0\0\0twist", 13), 0);
  expectArrayRefused(std::string("twist\x06\0\0\0", 9), 5);
  expectArrayRefused(std::string("\x05\0\0\0\xbe\0\0\0", 8), 4);
}

TEST_F(MapFile, AMapOfTheFormatBeforeIsRefusedByItsVersion) {
  for (const auto compression : {rosbag::compression::Uncompressed, rosbag::compression::LZ4}) {
    {
      rosbag::Bag bag(path_, rosbag::bagmode::Write);
      bag.setCompression(compression);
      bag.write("map", ros::Time(1000.0), Format1());
    }
    expectRefusal({": written by an older version (format 1), allowed: format 2; save it anew"});
  }
}

TEST_F(MapFile, OtherTopicsAndTypesAreRefused) {
  {
    rosbag::Bag bag(path_, rosbag::bagmode::Write);
    bag.write("/odometry", ros::Time(1.0), std_msgs::String());
  }
  expectRefusal({"topic map", "0 messages", "allowed: one"});
  {
    rosbag::Bag bag(path_, rosbag::bagmode::Write);
    bag.write("map", ros::Time(1.0), std_msgs::String());
  }
  expectRefusal({"topic map", "std_msgs/String", "vi_ekf_slam/MapState"});
  {
    rosbag::Bag bag(path_, rosbag::bagmode::Write);
    for (int i = 0; i < 2; ++i) bag.write("map", ros::Time(1.0), MapState());
  }
  expectRefusal({"topic map", "2 messages"});
}

/// A descriptor whose bytes are all `byte`.
Descriptor uniform(std::uint8_t byte) {
  Descriptor descriptor;
  descriptor.fill(byte);
  return descriptor;
}

TEST_F(MapFile, KeepsWhatLandmarksLookLike) {
  SavedMap map = example();
  map.landmarks[1].descriptors.add(uniform(0x0f));
  map.landmarks[3].descriptors.add(uniform(0xff));
  map.landmarks[3].descriptors.add(uniform(0x00));
  writeMapFile(path_, map, "map");
  const SavedMap again = readMapFile(path_);
  ASSERT_EQ(again.landmarks.size(), map.landmarks.size());
  for (std::size_t i = 0; i < map.landmarks.size(); ++i) {
    const DescriptorSet &expected = map.landmarks[i].descriptors, &looks = again.landmarks[i].descriptors;
    ASSERT_EQ(looks.size(), expected.size()) << i;
    for (std::size_t k = 0; k < looks.size(); ++k) EXPECT_EQ(looks[k], expected[k]);
  }
}

TEST_F(MapFile, RefusesLooksThatAreNone) {
  const auto put = [&](FeatureId id, std::size_t bytes, int times) {
    writeMapFile(path_, example(), "map");
    rosbag::Bag bag(path_, rosbag::bagmode::Append);
    MapDescriptors looks;
    looks.id = id;
    looks.descriptors.assign(bytes, 7);
    for (int i = 0; i < times; ++i) bag.write("descriptors", ros::Time(1000, 1), looks);
  };
  const FeatureId id = example().landmarks.front().id;
  put(id, 32, 1);
  EXPECT_EQ(readMapFile(path_).landmarks.front().descriptors.size(), 1u);
  put(5, 32, 1);
  expectRefusal({"descriptors.id is 5", "the id of a landmark"});
  put(id, 31, 1);
  expectRefusal({"31 bytes", "1 to 4 times 32"});
  put(id, 5 * 32, 1);
  expectRefusal({"160 bytes"});
  put(id, 0, 1);
  expectRefusal({"0 bytes"});
  put(id, 32, 2);
  expectRefusal({"there twice", "once"});
}

} // namespace
} // namespace vi_ekf_slam
