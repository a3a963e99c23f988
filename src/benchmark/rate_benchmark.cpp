/// What gyro and velocity at 400 Hz cost beside the same drive with both at 10 Hz, as the frames: the time
/// from one frame to the next, samples and frame, of two systems that are driven in turns.

#include <benchmark/benchmark.h>

#include <ctime>
#include <numeric>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/sensors/median.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/simulation/monte_carlo.hpp"
#include "vi_ekf_slam/simulation/stale_repair.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kFrameRate = 10.0, kFastRate = 400.0; // Hz
constexpr std::size_t kSettling = 50, kFrames = 600;   // the first are not counted

using Steps = std::vector<std::vector<Measurement>>; ///< what comes from a frame to the next

Steps fastDrive(int features) {
  simulation::DriveOptions options = simulation::studyOptions(simulation::MotionModel::kCarDrive);
  options.frame_rate = kFrameRate;
  options.imu_rate = kFastRate;
  options.duration = static_cast<double>(kSettling + kFrames) / kFrameRate;
  options.features_max = features;
  options.features_min = features / 2;
  simulation::DriveSimulator simulator(options);
  simulation::StaleRepair stale;
  Steps steps;
  while (auto step = simulator.next()) {
    stale.repair(*step);
    steps.push_back(measurementsOf(*step));
  }
  return steps;
}

/// The same frames, and of the samples those at a frame's stamp.
Steps thinned(Steps steps) {
  for (std::vector<Measurement>& step : steps) {
    const Stamp frame = stampOf(step.front());
    step.erase(std::remove_if(step.begin(), step.end(),
                              [frame](const Measurement& m) { return stampOf(m) != frame; }),
               step.end());
  }
  return steps;
}

/// s of this thread, which others on the machine do not lengthen.
double threadSeconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// A system on its way through a drive.
class Run {
 public:
  /// `odometry`: it is asked for its state after each gyro sample, as a node is that publishes it.
  Run(Steps steps, bool odometry) : steps_(std::move(steps)), system_(Config()) {
    simulation::DriveOptions options;
    system_.setRig(simulation::makeView(options).rig);
    system_.onFrame([](const Output& output) { benchmark::DoNotOptimize(output.state.twist[0]); });
    if (odometry)
      system_.onImu([](const Output& output) { benchmark::DoNotOptimize(output.state.twist[0]); });
  }

  /// To the next frame; s that it took.
  double advance() {
    const double start = threadSeconds();
    for (Measurement& measurement : steps_[next_]) system_.add(std::move(measurement));
    ++next_;
    return threadSeconds() - start;
  }

  SystemCounts counts() const { return system_.counts(); }

 private:
  Steps steps_;
  SlamSystem system_;
  std::size_t next_ = 0;
};

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

/// Arguments: features of a frame at most, whether the state is asked for with each gyro sample.
void rates(benchmark::State& run) {
  const Steps steps = fastDrive(static_cast<int>(run.range(0)));
  Run fast(steps, run.range(1) != 0), slow(thinned(steps), run.range(1) != 0);
  for (std::size_t k = 0; k < kSettling; ++k) {
    fast.advance();
    slow.advance();
  }
  std::vector<double> fast_ms, slow_ms;
  for (auto _ : run) {
    const bool fast_first = fast_ms.size() % 2 == 0;
    if (!fast_first) slow_ms.push_back(1e3 * slow.advance());
    fast_ms.push_back(1e3 * fast.advance());
    if (fast_first) slow_ms.push_back(1e3 * slow.advance());
    run.SetIterationTime(1e-3 * fast_ms.back());
  }
  const auto used = [](const Run& of) { return static_cast<double>(of.counts().features_used); };
  run.counters["used"] = used(fast) / static_cast<double>(kSettling + kFrames);
  run.counters["used_10Hz"] = used(slow) / static_cast<double>(kSettling + kFrames);
  run.counters["ms_10Hz"] = mean(slow_ms);
  run.counters["ms_400Hz"] = mean(fast_ms);
  run.counters["ratio"] = mean(fast_ms) / mean(slow_ms);
  run.counters["ratio_median"] = medianOf(fast_ms) / medianOf(slow_ms); // of the frames' times
}

BENCHMARK(rates)
    ->ArgNames({"features", "odometry"})
    ->ArgsProduct({{30, 60, 115, 230}, {0, 1}})
    ->Iterations(kFrames)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

} // namespace
} // namespace vi_ekf_slam
