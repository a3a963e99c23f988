/// Consistency study: many simulated drives in, tables out. See kMonteCarloHelp.
#include <sys/wait.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <iostream>
#include <sstream>

#include "monte_carlo_options.hpp"
#include "monte_carlo_report.hpp"
#include "program_options.hpp"
#include "progress.hpp"
#include "vi_ekf_slam/core/run/run_writer.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {
namespace {

constexpr int kOk = 0;
constexpr int kUsage = 1;
constexpr int kOutOfBounds = 3;

/// Runs plot.py of the workspace that is sourced; whether it went well.
bool plot(const std::string& directory) {
  const pid_t child = fork();
  if (child == 0) {
    execlp("rosrun", "rosrun", "vi_ekf_slam", "plot.py", "monte_carlo", directory.c_str(), nullptr);
    _exit(127);
  }
  int status = 0;
  return child > 0 && waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

std::string folderOf(const MonteCarloOptions& options, const simulation::DriveOptions& drive) {
  if (!options.comparesRates()) return options.output;
  std::ostringstream folder;
  folder << options.output << "/frames_" << drive.frame_rate << "_imu_" << drive.imuRate();
  return folder.str();
}

int run(const MonteCarloOptions& options) {
  const Config config = loadFullConfig(options.config).core;
  RunWriter::makeDirectory(options.output);
  const std::vector<simulation::DriveOptions> drives = drivesOf(options);
  std::vector<RateStudy> studies;
  Progress progress(!options.quiet);
  progress.show(0.0);
  const double all = static_cast<double>(options.seeds * drives.size());
  for (const simulation::DriveOptions& drive : drives) {
    const double before = static_cast<double>(options.seeds * studies.size());
    studies.push_back(
        {drive, simulation::runSeeds(
                    config, drive, options.first_seed, options.seeds, options.jobs,
                    [&](std::size_t done) { progress.show((before + static_cast<double>(done)) / all); },
                    options.study)});
    const std::string folder = folderOf(options, drive);
    RunWriter::makeDirectory(folder);
    writeMonteCarlo(folder, studies.back().results);
  }
  progress.finish();
  if (options.comparesRates()) writeRates(options.output, studies);
  if (!options.quiet) {
    std::cout << (options.comparesRates() ? ratesSummary(studies)
                                          : monteCarloSummary(studies.front().results))
              << "results in " << options.output << std::endl;
  }
  if (options.plot && !plot(options.output))
    std::cerr << "monte_carlo: rosrun vi_ekf_slam plot.py failed; nothing is drawn" << std::endl;
  const auto within = [&](const RateStudy& study) { return neesWithin(study.results, *options.check); };
  if (!options.check || std::all_of(studies.begin(), studies.end(), within)) return kOk;
  std::cerr << "monte_carlo: the mean pose NEES leaves the bounds " << options.check->first << " to "
            << options.check->second << std::endl;
  return kOutOfBounds;
}

} // namespace
} // namespace vi_ekf_slam

int main(int argc, char** argv) {
  using namespace vi_ekf_slam;
  try {
    const MonteCarloOptions options = parseMonteCarloOptions(argc, argv);
    if (options.help) {
      std::cout << kMonteCarloHelp;
      return kOk;
    }
    return run(options);
  } catch (const UsageError& e) {
    std::cerr << "monte_carlo: " << e.what() << "\nTry 'monte_carlo --help'." << std::endl;
  } catch (const std::exception& e) { // configuration, or an output that cannot be written
    std::cerr << "monte_carlo: " << e.what() << std::endl;
  }
  return kUsage;
}
