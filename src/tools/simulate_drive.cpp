/// Writes a simulated drive into a directory as .npy arrays; scripts/simulate_dataset.py packs them.

#include <cstdint>
#include <exception>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "program_options.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"
#include "vi_ekf_slam/simulation/npy.hpp"

namespace vi_ekf_slam::simulation {
namespace {

namespace po = boost::program_options;

constexpr char kUsage[] =
    "usage: simulate_drive [--progress] DIRECTORY [--OPTION VALUE]...\n"
    "       simulate_drive --describe\n\n"
    "Writes a simulated drive as .npy files into DIRECTORY, which must exist.\n";

struct Arguments {
  std::string directory;
  bool progress = false;
  DriveOptions drive;
};

po::options_description driveOptions(DriveOptions& drive) {
  po::options_description known("the drive");
  for (const DriveOptionField& field : driveOptionFields()) {
    const std::string standard = driveOptionText({}, field) + (*field.unit ? " " : "") + field.unit;
    auto* value = po::value<std::string>()->value_name("[" + standard + "]");
    value->notifier([&drive, &field](const std::string& text) { setDriveOption(drive, field.name, text); });
    known.add_options()(field.name, value, field.help);
  }
  return known;
}

/// What is to be written, or nothing where all that was asked for has been printed.
std::optional<Arguments> parse(int argc, char** argv) {
  Arguments arguments;
  bool help = argc == 1, describe = false;
  po::options_description known;
  known.add_options()("help,h", po::bool_switch(&help)->default_value(help), "this text")(
      "progress", po::bool_switch(&arguments.progress), "print 'progress PERCENT', a line each percent")(
      "describe", po::bool_switch(&describe),
      "print the drive's options as 'name TAB default TAB unit TAB help'");
  const po::options_description drive = driveOptions(arguments.drive);
  po::options_description all;
  all.add(known).add(drive).add_options()("directory", po::value(&arguments.directory));
  parseOptions(argc, argv, all, "directory");
  if (help) {
    std::cout << kUsage << known << '\n' << drive;
    return std::nullopt;
  }
  if (describe) {
    for (const DriveOptionField& field : driveOptionFields())
      std::cout << field.name << '\t' << driveOptionText({}, field) << '\t' << field.unit << '\t'
                << field.help << '\n';
    return std::nullopt;
  }
  if (arguments.directory.empty()) throw UsageError("no directory given");
  return arguments;
}

/// The arrays of a drive, as they grow.
class Columns {
 public:
  void add(const DriveStep& step) {
    stamps_.push_back(step.stamp);
    stale_.push_back(step.stale ? 1 : 0);
    append(twist_, step.velocity.front().linear_velocity);
    append(twist_, step.gyro.front().angular_velocity);
    append(true_twist_, step.true_twist.front());
    appendRows(poses_, step.world_T_imu);
    for (std::size_t i = 0; i < step.frame.features.size(); ++i) {
      const StereoFeatureObservation& feature = step.frame.features[i];
      frame_.push_back(static_cast<std::int64_t>(step.index));
      id_.push_back(static_cast<std::int64_t>(feature.id));
      point_.push_back(static_cast<std::int64_t>(step.truth[i].point));
      kind_.push_back(static_cast<std::int64_t>(step.truth[i].kind));
      append(pixels_, feature.pixels);
      append(world_, step.truth[i].world);
    }
  }

  void write(const std::string& directory, const StereoRig& rig) const {
    const std::size_t frames = stamps_.size(), seen = id_.size();
    const StereoCamera& c = rig.camera;
    std::vector<double> imu_T_cam;
    appendRows(imu_T_cam, rig.cam_T_imu.inverse());
    const std::vector<double> K = {c.fu, 0.0, c.cu, 0.0, c.fv, c.cv, 0.0, 0.0, 1.0};
    const auto write = [&](const char* name, const auto& values, const std::vector<std::size_t>& shape) {
      writeNpy(directory + "/" + name + ".npy", values, shape);
    };
    write("K", K, {3, 3});
    write("baseline", std::vector<double>{c.baseline}, {});
    write("imu_T_cam", imu_T_cam, {3, 4});
    write("stamp", stamps_, {frames});
    write("stale", stale_, {frames});
    write("twist", twist_, {frames, 6});
    write("true_twist", true_twist_, {frames, 6});
    write("world_T_imu", poses_, {frames, 3, 4});
    write("observation_frame", frame_, {seen});
    write("observation_id", id_, {seen});
    write("observation_pixels", pixels_, {seen, 4});
    write("observation_point", point_, {seen});
    write("observation_kind", kind_, {seen});
    write("observation_world", world_, {seen, 3});
  }

 private:
  template <class Vector>
  static void append(std::vector<double>& column, const Vector& v) {
    column.insert(column.end(), v.data(), v.data() + v.size());
  }

  static void appendRows(std::vector<double>& column, const SE3& pose) {
    const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> rows = pose.matrix().topRows<3>();
    append(column, rows);
  }

  std::vector<std::int64_t> stamps_, stale_, frame_, id_, point_, kind_;
  std::vector<double> twist_, true_twist_, poses_, pixels_, world_;
};

void run(const Arguments& arguments) {
  const DriveOptions& options = arguments.drive;
  if (options.hasRawImu()) {
    throw std::invalid_argument("option 'motion' is '" + std::string(nameOf(options.motion)) +
                                "', allowed: car or process: a dataset has one twist a frame");
  }
  DriveSimulator simulator(options);
  if (options.imuRate() != options.frame_rate) {
    throw std::invalid_argument(
        "option 'imu-rate' must be 0 or equal frame-rate: a dataset has one twist a frame");
  }
  Columns columns;
  int percent = -1;
  while (const std::optional<DriveStep> step = simulator.next()) {
    columns.add(*step);
    const int now = static_cast<int>(100.0 * simulator.progress());
    if (arguments.progress && now != percent) std::cout << "progress " << now << std::endl;
    percent = now;
  }
  columns.write(arguments.directory, simulator.rig());
}

} // namespace
} // namespace vi_ekf_slam::simulation

int main(int argc, char** argv) {
  namespace sim = vi_ekf_slam::simulation;
  try {
    if (const auto arguments = sim::parse(argc, argv)) sim::run(*arguments);
  } catch (const std::exception& error) {
    std::cerr << "simulate_drive: " << error.what() << std::endl;
    return 1;
  }
  return 0;
}
