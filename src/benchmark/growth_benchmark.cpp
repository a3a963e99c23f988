/// How time and memory of a frame grow with the landmarks in view and with those out of view: propagation, a
/// frame of all landmarks in view, some of which leave the view and are kept, as many that come into it, and
/// the oldest ones marginalised in batches, so that the number out of view stays what it is. Flushing
/// deferred updates is part of it, as it comes.

#include <benchmark/benchmark.h>
#include <malloc.h>

#include <algorithm>
#include <ctime>
#include <fstream>
#include <string>

#include "resting_scene.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kLife = 12; // frames that a landmark is in view, as in the median of the real drives
// Frames times landmarks in view: all landmarks in view change five times at least, and deferred updates are
// composed some ten times.
constexpr std::size_t kObservations = 24000;

/// Landmarks come into view and leave it; at most `inactive` of these are kept.
class Traffic {
 public:
  Traffic(std::size_t active, std::size_t inactive)
      : active_(active),
        next_(active),
        scene_(active, {inactive > 0 ? MapKeep::kAll : MapKeep::kNone, 0.0, 1, inactive}) {
    const std::size_t in_a_frame = active / kLife + 1; // with one frame more the oldest might go
    while (this->inactive() + in_a_frame < inactive) step();
  }

  struct Frame {
    double seconds;
    std::size_t used;
  };
  Frame step() {
    const StereoFrame frame = scene_.look();
    std::vector<StereoFeatureObservation> arrivals;
    for (leaving_ += active_; leaving_ >= kLife; leaving_ -= kLife) arrivals.push_back(scene_.see(next_++));
    const std::clock_t start = std::clock();
    scene_.advance();
    const FrameOutcome outcome = scene_.correct(frame);
    for (std::size_t i = 0; i < arrivals.size(); ++i) {
      const auto& landmarks = scene_.map.active();
      const auto oldest = std::min_element(landmarks.begin(), landmarks.end(),
                                           [](const Landmark& a, const Landmark& b) { return a.id < b.id; });
      scene_.map.leave(scene_.filter, static_cast<std::size_t>(oldest - landmarks.begin()));
    }
    for (const StereoFeatureObservation& arrival : arrivals) scene_.initialise(arrival);
    scene_.map.bound(scene_.filter);
    return {static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC, countTrue(outcome.used)};
  }

  std::size_t inactive() const { return scene_.filter.inactive().size(); }
  std::size_t bytes() const {
    return scene_.filter.inactive().bytes() +
           static_cast<std::size_t>(scene_.filter.rows() * scene_.filter.rows()) * sizeof(double);
  }

 private:
  std::size_t active_;
  FeatureId next_;
  std::size_t leaving_ = 0; ///< the active ones of each frame so far that have not left yet
  RestingScene scene_;
};

/// Largest resident memory since the last resetPeak, MB (Linux).
double peakMegabytes() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    double kilobytes = 0.0;
    if (word == "VmHWM:" && status >> kilobytes) return kilobytes / 1024.0;
  }
  return 0.0;
}
void resetPeak() {
  malloc_trim(0); // what earlier cases left
  std::ofstream("/proc/self/clear_refs") << "5";
}

/// Arguments: landmarks in view, landmarks out of view.
void growth(benchmark::State& run) {
  const auto active = static_cast<std::size_t>(run.range(0)),
             inactive = static_cast<std::size_t>(run.range(1));
  Traffic traffic(active, inactive);
  resetPeak();
  std::vector<double> times;
  std::size_t used = 0, bytes = 0, least = inactive;
  for (auto _ : run) {
    const Traffic::Frame frame = traffic.step();
    run.SetIterationTime(frame.seconds);
    times.push_back(1e3 * frame.seconds);
    used += frame.used;
    bytes = std::max(bytes, traffic.bytes());
    least = std::min(least, traffic.inactive());
  }
  if (used < times.size() * active * 9 / 10) run.SkipWithError("features are rejected");
  std::sort(times.begin(), times.end());
  run.counters["median_ms"] = times[times.size() / 2];
  run.counters["worst_ms"] = times.back();
  run.counters["map_mb"] = static_cast<double>(bytes) / (1 << 20);
  run.counters["peak_mb"] = peakMegabytes();
  run.counters["inactive_least"] = static_cast<double>(least);
}

} // namespace
} // namespace vi_ekf_slam

int main(int argc, char** argv) {
  using namespace vi_ekf_slam;
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  for (const int active : {25, 50, 100, 200, 400}) {
    benchmark::RegisterBenchmark("growth", growth)
        ->ArgNames({"active", "inactive"})
        ->ArgsProduct({{active}, {0, 500, 1000, 2000, 5000, 10000}})
        ->Iterations(static_cast<benchmark::IterationCount>(kObservations) / active)
        ->UseManualTime()
        ->Unit(benchmark::kMillisecond);
  }
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
