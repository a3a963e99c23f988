/// Writes a simulated drive into a directory as .npy arrays; scripts/simulate_dataset.py packs them.

#include <cstdint>
#include <cstring>
#include <exception>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

#include "vi_ekf_slam/simulation/drive_simulator.hpp"
#include "vi_ekf_slam/simulation/npy.hpp"

namespace vi_ekf_slam::simulation {
namespace {

void printUsage() {
  std::cout << "usage: simulate_drive [--progress] DIRECTORY [--OPTION VALUE]...\n"
               "       simulate_drive --describe\n\n"
               "Writes a simulated drive as .npy files into DIRECTORY, which must exist.\n"
               "--progress prints the fraction that is done, a line each percent; --describe prints the "
               "options as\n"
               "lines 'name TAB default TAB unit TAB help'.\n\noptions:\n";
  for (const DriveOptionField& field : driveOptionFields()) {
    std::cout << "  --" << field.name << " [" << driveOptionText({}, field) << (*field.unit ? " " : "")
              << field.unit << "]  " << field.help << "\n";
  }
}

void describe() {
  for (const DriveOptionField& field : driveOptionFields()) {
    std::cout << field.name << '\t' << driveOptionText({}, field) << '\t' << field.unit << '\t' << field.help
              << '\n';
  }
}

struct Arguments {
  std::string directory;
  bool progress = false;
  DriveOptions options;
};

Arguments parse(const std::vector<std::string>& words) {
  Arguments arguments;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i] == "--progress") {
      arguments.progress = true;
    } else if (words[i].compare(0, 2, "--") == 0) {
      const std::string name = words[i].substr(2);
      if (i + 1 == words.size()) throw std::invalid_argument("option '" + name + "' has no value");
      setDriveOption(arguments.options, name, words[++i]);
    } else if (arguments.directory.empty()) {
      arguments.directory = words[i];
    } else {
      throw std::invalid_argument("one directory only, not also '" + words[i] + "'");
    }
  }
  if (arguments.directory.empty()) throw std::invalid_argument("no directory given");
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
    append(true_twist_, step.true_twist.front().twist);
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
    writeNpy(directory + "/K.npy", K, {3, 3});
    writeNpy(directory + "/baseline.npy", std::vector<double>{c.baseline}, {});
    writeNpy(directory + "/imu_T_cam.npy", imu_T_cam, {3, 4});
    writeNpy(directory + "/stamp.npy", stamps_, {frames});
    writeNpy(directory + "/stale.npy", stale_, {frames});
    writeNpy(directory + "/twist.npy", twist_, {frames, 6});
    writeNpy(directory + "/true_twist.npy", true_twist_, {frames, 6});
    writeNpy(directory + "/world_T_imu.npy", poses_, {frames, 3, 4});
    writeNpy(directory + "/observation_frame.npy", frame_, {seen});
    writeNpy(directory + "/observation_id.npy", id_, {seen});
    writeNpy(directory + "/observation_pixels.npy", pixels_, {seen, 4});
    writeNpy(directory + "/observation_point.npy", point_, {seen});
    writeNpy(directory + "/observation_kind.npy", kind_, {seen});
    writeNpy(directory + "/observation_world.npy", world_, {seen, 3});
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
  const DriveOptions& options = arguments.options;
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
  const std::vector<std::string> words(argv + 1, argv + argc);
  try {
    if (words.empty() || words[0] == "--help" || words[0] == "-h") {
      sim::printUsage();
    } else if (words[0] == "--describe") {
      sim::describe();
    } else {
      sim::run(sim::parse(words));
    }
  } catch (const std::exception& error) {
    std::cerr << "simulate_drive: " << error.what() << std::endl;
    return 1;
  }
  return 0;
}
