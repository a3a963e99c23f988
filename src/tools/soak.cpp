/// Drives for a day of sensor time, as fast as it goes, through the node's own input path: messages, Intake,
/// SlamSystem, OutputSequencer, what would be published, files. Ends with 1 when memory grows, a number is
/// none, or a pose is missing.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "program_options.hpp"
#include "vi_ekf_slam/core/run/memory.hpp"
#include "vi_ekf_slam/core/run/run_writer.hpp"
#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/output/map_messages.hpp"
#include "vi_ekf_slam/ros/output/output_sequencer.hpp"
#include "vi_ekf_slam/ros/output/path_publisher.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kFrameRate = 10.0;    // Hz
constexpr double kReportPeriod = 3600; // s of sensor time
constexpr double kMapPeriod = 60.0;    // s of sensor time between maps as messages
constexpr double kMemoryPeriod = 1.0;  // s of sensor time between samples
constexpr std::size_t kHour = 3600;    // samples
constexpr double kAllowedGrowth = 0.05;

const char* const kUsage =
    "usage: soak [--frames N] [--features N] [--seed N] [--output DIR]\n"
    "  --frames N    10 Hz; default 864000, a day\n"
    "  --features N  of a frame at most; default 55\n"
    "  --seed N      of the simulated drive; default 1\n"
    "  --output DIR  for the results; default: a folder below the temporary one\n";

struct Options {
  std::size_t frames = 864000;
  int features = 55;
  std::uint64_t seed = 1;
  std::string output;
  bool help = false;
};

Options parse(int argc, char** argv) {
  Options options;
  namespace po = boost::program_options;
  const auto number = [](const char* name, std::uint64_t most, auto take) {
    return po::value<std::string>()->notifier(
        [=](const std::string& text) { take(wholeNumber(name, text, 1, most)); });
  };
  po::options_description known; // kUsage describes them
  known.add_options()("help,h", po::bool_switch(&options.help))("output", po::value(&options.output))(
      "frames", number("--frames", 100000000, [&](auto n) { options.frames = n; }))(
      "features", number("--features", 1000, [&](auto n) { options.features = static_cast<int>(n); }))(
      "seed", number("--seed", 1000000, [&](auto n) { options.seed = n; }));
  parseOptions(argc, argv, known);
  return options;
}

/// MB of resident memory.
double residentMegabytes() {
  std::ifstream statm("/proc/self/statm");
  std::size_t all = 0, resident = 0;
  if (!(statm >> all >> resident)) throw std::runtime_error("/proc/self/statm cannot be read");
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

template <int size>
using RowMajor = Eigen::Map<Eigen::Matrix<double, size, size, Eigen::RowMajor>>;

void put(const Eigen::Vector3d& from, geometry_msgs::Vector3& to) {
  to.x = from.x();
  to.y = from.y();
  to.z = from.z();
}

sensor_msgs::Imu toMessage(const ImuSample& sample) {
  sensor_msgs::Imu message;
  message.header = conversions::toHeader(sample.stamp, "imu");
  put(sample.angular_velocity, message.angular_velocity);
  if (sample.covariance) RowMajor<3>(message.angular_velocity_covariance.data()) = *sample.covariance;
  return message;
}

geometry_msgs::TwistWithCovarianceStamped toMessage(const VelocitySample& sample) {
  geometry_msgs::TwistWithCovarianceStamped message;
  message.header = conversions::toHeader(sample.stamp, "imu");
  put(sample.linear_velocity, message.twist.twist.linear);
  if (sample.covariance)
    RowMajor<6>(message.twist.covariance.data()).topLeftCorner<3, 3>() = *sample.covariance;
  return message;
}

StereoFeatureArray toMessage(const StereoFrame& frame) { return conversions::toMessage(frame, "left"); }

/// The node without its topics.
class Soak {
 public:
  explicit Soak(const Options& options)
      : options_(options),
        system_({}),
        intake_(system_, config_, {}),
        sequencer_([this](const Output& output, bool is_frame) { publish(output, is_frame); }),
        path_(config_.map_frame) {
    system_.onImu([this](const Output& output) { sequencer_.add(output, false); });
    system_.onFrame([this](const Output& output) {
      sequencer_.add(output, true);
      writer_.addFrame(output);
    });
    system_.onReset([this](const std::string& reason, const PathEstimate&) { problem("reset: " + reason); });
  }

  /// Whether all went well.
  bool run() {
    simulation::DriveOptions drive;
    drive.seed = options_.seed;
    drive.features_max = options_.features;
    drive.features_min = std::min(drive.features_min, options_.features / 2 + 1);
    drive.duration = static_cast<double>(options_.frames) / kFrameRate;
    drive.frame_rate = kFrameRate;
    drive.track_median = 0.4; // short tracks: map and archive fill soon
    simulation::DriveSimulator simulator(drive);
    system_.setRig(simulator.rig());
    while (auto step = simulator.next()) {
      if (fed_ == options_.frames) break;
      for (const Measurement& measurement : simulation::measurementsOf(*step)) {
        std::visit([this](const auto& sample) { intake_.add(toMessage(sample)); }, measurement);
        sequencer_.endOfDrain();
      }
      ++fed_;
      if (fed_ % static_cast<std::size_t>(kMemoryPeriod * kFrameRate) == 0)
        memory_.push_back(residentMegabytes());
      if (fed_ % static_cast<std::size_t>(kReportPeriod * kFrameRate) == 0) report();
    }
    system_.flush();
    sequencer_.endOfDrain();
    report();
    return finish();
  }

 private:
  void problem(const std::string& text) {
    if (++problems_ <= 20) std::cerr << "PROBLEM: " << text << std::endl;
  }

  void publish(const Output& output, bool is_frame) {
    const nav_msgs::Odometry odometry = conversions::toOdometry(output.state, config_.map_frame, "imu");
    double sum =
        odometry.pose.pose.position.x + odometry.pose.pose.position.y + odometry.pose.pose.orientation.w;
    for (const double c : odometry.pose.covariance) sum += c;
    for (const double c : odometry.twist.covariance) sum += c;
    if (!std::isfinite(sum)) problem("not finite at frame " + std::to_string(frames_));
    if (is_frame) {
      if (output.state.stamp <= last_stamp_)
        problem("stamps do not grow at frame " + std::to_string(frames_));
      last_stamp_ = output.state.stamp;
      ++frames_;
    }
    path_.add(output.state.stamp, output.state.world_T_imu);
    if (is_frame && frames_ % static_cast<std::size_t>(kMapPeriod * kFrameRate) == 0) {
      map_bytes_ =
          toCloud(system_.estimator().landmarks(), output.state.stamp, config_.map_frame).data.size();
    }
  }

  void report() {
    const double hours = static_cast<double>(fed_) / kFrameRate / 3600.0;
    std::printf("%.2f h, %zu frames, %.0f frames/s, %.1f MB, path %zu points, map message %zu bytes\n", hours,
                fed_, static_cast<double>(fed_) / seconds(),
                meanMemory(memory_.size() - std::min(memory_.size(), kHour)), path_.message().poses.size(),
                map_bytes_);
    std::fflush(stdout);
  }

  /// MB, from a sample on, for an hour at most.
  double meanMemory(std::size_t from) const {
    const std::size_t count = std::min(kHour, memory_.size() - from);
    double sum = 0.0;
    for (std::size_t i = from; i < from + count; ++i) sum += memory_[i];
    return count > 0 ? sum / static_cast<double>(count) : 0.0;
  }

  /// How much more of it the hour of the last third that needs most has in the mean than the quarter of an
  /// hour before; 0 where the archive of landmarks is not full then, which it is after an hour. The moment
  /// tells little: the map grows and is cut every few seconds.
  double memoryGrowth() const {
    constexpr std::size_t kQuarter = kHour / 4;
    const std::size_t full = memory_.size() * 2 / 3;
    if (full < kHour) return 0.0;
    double reference = 0.0, largest = 0.0;
    for (std::size_t i = full - kQuarter; i < full; ++i) reference += memory_[i] / kQuarter;
    for (std::size_t from = full; from + kQuarter <= memory_.size(); from += kHour)
      largest = std::max(largest, meanMemory(from));
    return largest / reference - 1.0;
  }

  bool finish() {
    RunWriter::makeDirectory(options_.output);
    RunSummary summary(system_);
    summary.input = "soak";
    summary.config = "default";
    summary.wall_s = seconds();
    summary.turned_away = intake_.turnedAway();
    summary.body = "imu";
    const MapEstimate map{system_.estimator().landmarks(), system_.estimator().path()};
    writer_.write(options_.output, summary, map);
    std::ifstream file(options_.output + "/trajectory.tum");
    std::size_t lines = 0;
    for (std::string line; std::getline(file, line);) {
      ++lines;
      if (line.find("nan") != std::string::npos || line.find("inf") != std::string::npos)
        problem("in a file: " + line);
    }
    if (frames_ != options_.frames || lines != frames_) {
      problem(std::to_string(options_.frames) + " frames, " + std::to_string(frames_) + " answered, " +
              std::to_string(lines) + " in trajectory.tum");
    }
    const double growth = memoryGrowth();
    const double peak =
        memory_.empty() ? residentMegabytes() : *std::max_element(memory_.begin(), memory_.end());
    if (growth > kAllowedGrowth) problem("memory has grown in the last third");
    std::printf(
        "%zu frames in %.0f s, memory %.1f MB at most, %+.2f %% in the last third, %zu landmarks, %zu "
        "problems\n",
        frames_, seconds(), peak, 100.0 * growth, map.landmarks.size(), problems_);
    return problems_ == 0;
  }

  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

  Options options_;
  RosConfig config_;
  SlamSystem system_;
  Intake intake_;
  OutputSequencer sequencer_;
  PathRecorder path_;
  RunWriter writer_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::size_t fed_ = 0, frames_ = 0, problems_ = 0, map_bytes_ = 0;
  Stamp last_stamp_ = 0;
  std::vector<double> memory_; ///< MB, sample by sample
};

} // namespace
} // namespace vi_ekf_slam

int main(int argc, char** argv) {
  vi_ekf_slam::keepFreedMemory();
  try {
    vi_ekf_slam::Options options = vi_ekf_slam::parse(argc, argv);
    if (options.help) {
      std::cout << vi_ekf_slam::kUsage;
      return 0;
    }
    if (options.output.empty()) {
      const char* folder = std::getenv("TMPDIR");
      options.output = std::string(folder != nullptr ? folder : "/tmp") + "/vi_ekf_slam_soak";
    }
    return vi_ekf_slam::Soak(options).run() ? 0 : 1;
  } catch (const std::exception& e) {
    std::cerr << e.what() << std::endl;
    return 1;
  }
}
