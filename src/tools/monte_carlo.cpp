/// Consistency study: many simulated drives in, tables out. See kMonteCarloHelp.
#include <sys/wait.h>

#include <cstdio>
#include <exception>
#include <iostream>

#include "monte_carlo_options.hpp"
#include "monte_carlo_report.hpp"
#include "progress.hpp"
#include "vi_ekf_slam/core/run/run_writer.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {
namespace {

constexpr int kOk = 0;
constexpr int kUsage = 1;
constexpr int kOutOfBounds = 3;

/// Runs plot_monte_carlo.py of the workspace that is sourced; whether it went well.
bool plot(const std::string& directory) {
  const pid_t child = fork();
  if (child == 0) {
    execlp("rosrun", "rosrun", "vi_ekf_slam", "plot_monte_carlo.py", directory.c_str(), nullptr);
    _exit(127);
  }
  int status = 0;
  return child > 0 && waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

int run(const MonteCarloOptions& options) {
  const Config config = loadFullConfig(options.config).core;
  RunWriter::makeDirectory(options.output);
  Progress progress(!options.quiet);
  progress.show(0.0);
  const auto results = simulation::runSeeds(
      config, options.drive, options.first_seed, options.seeds, options.jobs, [&](std::size_t done) {
        progress.show(static_cast<double>(done) / static_cast<double>(options.seeds));
      });
  progress.finish();
  writeMonteCarlo(options.output, results);
  if (!options.quiet) std::cout << monteCarloSummary(results) << "results in " << options.output << std::endl;
  if (options.plot && !plot(options.output))
    std::cerr << "monte_carlo: rosrun vi_ekf_slam plot_monte_carlo.py failed; nothing is drawn" << std::endl;
  if (!options.check || neesWithin(results, *options.check)) return kOk;
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
  } catch (const MonteCarloUsageError& e) {
    std::cerr << "monte_carlo: " << e.what() << "\nTry 'monte_carlo --help'." << std::endl;
  } catch (const std::exception& e) { // configuration, or an output that cannot be written
    std::cerr << "monte_carlo: " << e.what() << std::endl;
  }
  return kUsage;
}
