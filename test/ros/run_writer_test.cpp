#include "vi_ekf_slam/core/run/run_writer.hpp"

#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <Eigen/Geometry>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <stdexcept>

#include "folder.hpp"

namespace vi_ekf_slam {
namespace {

namespace fs = std::filesystem;

Output output(Stamp stamp, double angle) {
  Output o;
  o.state.stamp = o.report.stamp = stamp;
  Vector6d xi;
  xi << 1.0, -2.0, 1e4 + 1.0 / 3.0, 0.0, 0.0, angle;
  o.state.world_T_imu = SE3::Exp(xi);
  for (Eigen::Index i = 0; i < 6; ++i) {
    for (Eigen::Index j = 0; j < 6; ++j)
      o.state.pose_covariance(i, j) = static_cast<double>(10 * i + j) / 3.0;
  }
  o.report.features = 12;
  o.report.used = 5;
  return o;
}

class RunWriterFiles : public InFolder {
 protected:
  std::vector<std::string> lines(const std::string& name) const {
    std::ifstream file(at(name));
    std::vector<std::string> all;
    for (std::string line; std::getline(file, line);) all.push_back(line);
    return all;
  }
  RunWriter writer_;
};

// Where root may write all, the process gives up being root.
TEST_F(RunWriterFiles, a_directory_that_is_there_and_cannot_be_written_is_refused_early) {
  RunWriter::requireDirectory(directory_);
  fs::permissions(directory_, fs::perms(0555));
  const auto refuse = [this] {
    constexpr uid_t kNobody = 65534;
    if (geteuid() == 0 && setuid(kNobody) != 0) std::exit(2);
    try {
      RunWriter::requireDirectory(directory_);
    } catch (const std::runtime_error& error) {
      std::cerr << error.what() << std::endl;
      std::exit(1);
    }
    std::exit(0);
  };
  EXPECT_EXIT(refuse(), testing::ExitedWithCode(1), directory_ + ": cannot be written: ");
}

TEST(StampText, is_exact) {
  EXPECT_EQ("1317386425.562502384", stampText(1317386425562502384));
  EXPECT_EQ("0.000000001", stampText(1));
  EXPECT_EQ("-1.500000000", stampText(-1500000000));
}

TEST_F(RunWriterFiles, a_trajectory_line_reads_back_to_the_pose) {
  for (const double angle : {0.3, 3.0, -3.0}) writer_.addFrame(output(5, angle));
  writer_.writeTrajectory(directory_);
  ASSERT_EQ(3U, lines("trajectory.tum").size());
  int i = 0;
  for (const double angle : {0.3, 3.0, -3.0}) {
    std::istringstream line(lines("trajectory.tum")[static_cast<std::size_t>(i++)]);
    std::string stamp;
    double x, y, z, qx, qy, qz, qw;
    ASSERT_TRUE(line >> stamp >> x >> y >> z >> qx >> qy >> qz >> qw);
    EXPECT_EQ("0.000000005", stamp);
    const SE3 expected = output(5, angle).state.world_T_imu;
    EXPECT_LT((Eigen::Vector3d(x, y, z) - expected.translation()).norm(), 1e-9);
    const Eigen::Matrix3d R = Eigen::Quaterniond(qw, qx, qy, qz).toRotationMatrix();
    EXPECT_LT((R - expected.rotation()).cwiseAbs().maxCoeff(), 1e-11);
    EXPECT_GE(qw, 0.0);
  }
}

TEST_F(RunWriterFiles, covariance_is_the_upper_triangle_row_by_row) {
  writer_.addFrame(output(5, 0.0));
  writer_.writeTrajectory(directory_);
  EXPECT_EQ("stamp,xx,xy,xz,xa,xb,xc,yy,yz,ya,yb,yc,zz,za,zb,zc,aa,ab,ac,bb,bc,cc",
            lines("covariance.csv")[0]);
  std::istringstream line(lines("covariance.csv")[1]);
  std::vector<double> values;
  for (std::string cell; std::getline(line, cell, ',');) values.push_back(std::stod(cell));
  ASSERT_EQ(22U, values.size());
  EXPECT_EQ(1.0 / 3.0, values[2]);   // xy, all digits
  EXPECT_EQ(25.0 / 3.0, values[15]); // zc
}

TEST_F(RunWriterFiles, gyro_samples_count_only_without_frames) {
  writer_.addGyro(output(1, 0.0));
  writer_.addGyro(output(2, 0.0));
  EXPECT_EQ(2U, writer_.size());
  EXPECT_FALSE(writer_.hasFrames());
  writer_.addFrame(output(3, 0.0));
  writer_.addGyro(output(4, 0.0));
  writer_.writeTrajectory(directory_);
  EXPECT_EQ(1U, lines("trajectory.tum").size());
  EXPECT_EQ(2U, lines("frames.csv").size()); // with the header
}

TEST_F(RunWriterFiles, what_came_before_a_reset_is_kept_apart) {
  writer_.addFrame(output(10, 0.0));
  writer_.addFrame(output(11, 0.0));
  writer_.restart();
  writer_.restart(); // nothing between: no empty folder
  writer_.addFrame(output(1, 0.0));
  writer_.writeTrajectory(directory_);
  EXPECT_EQ(1U, lines("trajectory.tum").size());
  EXPECT_EQ(2U, lines("before_reset_1/trajectory.tum").size());
  EXPECT_FALSE(fs::exists(directory_ + "/before_reset_2"));
}

TEST_F(RunWriterFiles, what_is_known_of_a_path_at_a_reset_is_kept_with_it) {
  writer_.addFrame(output(10, 0.0));
  writer_.restart(); // nobody knows of it
  writer_.addFrame(output(20, 0.0));
  PathNode node;
  node.stamp = 20;
  node.before = node.after = output(20, 0.0).state.world_T_imu;
  node.now = SE3(Eigen::Matrix3d::Identity(), {0.0, 0.0, 0.5}) * node.after;
  writer_.restart(PathEstimate{{node}, {}});
  writer_.addFrame(output(30, 0.0));
  writer_.writeTrajectory(directory_);
  EXPECT_FALSE(fs::exists(directory_ + "/before_reset_1/trajectory_smoothed.tum"));
  ASSERT_EQ(1U, lines("before_reset_2/trajectory_smoothed.tum").size());
  ASSERT_EQ(2U, lines("before_reset_2/covariance_smoothed.csv").size()); // with the header
  const auto height = [this](const std::string& name) {
    std::istringstream line(lines("before_reset_2/" + name).front());
    double stamp, x, y, z;
    line >> stamp >> x >> y >> z;
    return z;
  };
  EXPECT_NEAR(0.5, height("trajectory_smoothed.tum") - height("trajectory.tum"), 1e-9);
}

TEST_F(RunWriterFiles, map_and_summary_read_back) {
  LandmarkEstimate landmark;
  landmark.id = 18446744073709551615ULL;
  landmark.position = {1.0, 2.0, 3.0};
  landmark.covariance << 1, 2, 3, 2, 4, 5, 3, 5, 6;
  writer_.writeMap(directory_, {landmark});
  ASSERT_EQ(2U, lines("landmarks.csv").size());
  EXPECT_EQ("18446744073709551615,1.000000000,2.000000000,3.000000000,1,2,3,4,5,6",
            lines("landmarks.csv")[1]);

  writer_.addFrame(output(0, 0.0));
  writer_.addFrame(output(3000000000, 0.0));
  RunSummary summary;
  summary.input = "a \"quoted\": bag";
  summary.wall_s = 1.5;
  summary.counts.late = {1, 2, 3};
  summary.counts.divergences = {0, 1, 2, 3, 4};
  summary.counts.blind_s = 2.5;
  summary.turned_away["imu: wrong frame"] = 4;
  summary.noise = {{"gyro", 0.05, "rad/s", "from its messages"}, {"pixels", 1.15, "px", "a \"key\": so"}};
  summary.motion = "inertial, the IMU's messages carry accelerations";
  summary.not_started = "gravity is not explained: 1 m/s^2";
  summary.counts.frames_before_start = 7;
  summary.imu = {1, 2, 3};
  writer_.write(directory_, summary, {{landmark}, {}});
  const YAML::Node node = YAML::LoadFile(directory_ + "/summary.yaml");
  EXPECT_EQ(summary.input, node["input"].as<std::string>());
  EXPECT_EQ(2, node["frames"].as<int>());
  EXPECT_EQ(6, node["late"]["total"].as<int>());
  EXPECT_EQ(10, node["divergences"]["total"].as<int>());
  EXPECT_EQ(3, node["divergences"]["jump"].as<int>());
  EXPECT_DOUBLE_EQ(2.5, node["blind_s"].as<double>());
  EXPECT_EQ(4, node["turned_away"]["imu: wrong frame"].as<int>());
  EXPECT_DOUBLE_EQ(2.0, node["times_real_time"].as<double>());
  EXPECT_EQ(summary.motion, node["motion"].as<std::string>());
  EXPECT_EQ(summary.not_started, node["not_started"].as<std::string>());
  EXPECT_EQ(7, node["frames_before_start"].as<int>());
  EXPECT_EQ(1, node["imu"]["stutters"].as<int>());
  EXPECT_EQ(2, node["imu"]["backwards"].as<int>());
  EXPECT_EQ(3, node["imu"]["stops"].as<int>());
  EXPECT_EQ(2U, node["noise"].size());
  EXPECT_EQ(0.05, node["noise"]["gyro"]["value"].as<double>());
  EXPECT_EQ("rad/s", node["noise"]["gyro"]["unit"].as<std::string>());
  EXPECT_EQ("a \"key\": so", node["noise"]["pixels"]["source"].as<std::string>());
}

TEST_F(RunWriterFiles, leaves_no_temporary_files_and_names_a_folder_it_cannot_make) {
  writer_.addFrame(output(5, 0.0));
  writer_.writeTrajectory(directory_);
  for (const auto& entry : fs::directory_iterator(directory_)) EXPECT_NE(".tmp", entry.path().extension());
  const std::string inside_a_file = directory_ + "/trajectory.tum/sub";
  try {
    writer_.writeTrajectory(inside_a_file);
    FAIL() << "wrote below a file";
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string::npos, std::string(e.what()).find(inside_a_file));
  }
}

} // namespace
} // namespace vi_ekf_slam
