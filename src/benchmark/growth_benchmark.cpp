/// How time and memory of a frame grow with the landmarks in view and with those out of view: propagation, a
/// frame of all landmarks in view, some of which leave the view and are kept, as many that come into it, and
/// the oldest ones marginalised in batches, so that the number out of view stays what it is. Settling is part
/// of it, as it comes.

#include <benchmark/benchmark.h>
#include <malloc.h>

#include <Eigen/Core>
#include <algorithm>
#include <ctime>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/frame_update.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr std::size_t kLife = 12; // frames that a landmark is in view, as in the median of the real drives
// Frames times landmarks in view: all landmarks in view change five times at least, and the deferred steps
// are composed some ten times.
constexpr std::size_t kSightings = 24000;

struct Frame {
  double seconds = 0.0;
  std::size_t used = 0, bytes = 0;
};

/// A vehicle at rest before points that come and go.
class Scene {
 public:
  explicit Scene(std::size_t active)
      : active_(active),
        model_(rig(), config_.pixel_sigma, config_.min_depth_m),
        state_({Vector6d::Constant(1e-6), config_.prior_twist_sigma, config_.prior_bias_sigma}, true,
               config_.map.deferred_mb << 20) {
    while (state_.landmarks().size() < active_) add(see(next_id_));
    for (int k = 0; k < 5; ++k) step(0);
  }

  /// Until `inactive` landmarks are out of view.
  void fill(std::size_t inactive) {
    while (state_.inactive().size() < inactive) step(std::numeric_limits<std::size_t>::max());
  }

  /// A frame, after which at most `most` landmarks that left are kept.
  Frame step(std::size_t most) {
    StereoFrame frame;
    for (const Landmark& landmark : state_.landmarks()) frame.features.push_back(see(landmark.id));
    leaving_ += active_;
    std::vector<StereoFeatureObservation> arrivals;
    for (; leaving_ >= kLife; leaving_ -= kLife) arrivals.push_back(see(next_id_));

    const std::clock_t start = std::clock();
    state_.propagate(0.1, {config_.twist_density, config_.bias_density});
    std::vector<Observation> observations;
    for (std::size_t i = 0; i < frame.features.size(); ++i) {
      observations.push_back(*model_.observe(state_, i, frame.features[i].pixels));
      observations.back().feature = i;
    }
    const FrameOutcome outcome =
        FrameUpdate(config_, model_).apply(state_, frame, std::move(observations), {});
    for (std::size_t i = 0; i < arrivals.size(); ++i) removeOldest(most > 0);
    for (const StereoFeatureObservation& arrival : arrivals) add(arrival);
    if (state_.inactive().size() > most) state_.marginaliseOldest(state_.inactive().size() - most + most / 4);
    Frame done;
    done.seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    done.used = static_cast<std::size_t>(std::count(outcome.used.begin(), outcome.used.end(), true));
    done.bytes =
        state_.inactive().bytes() + static_cast<std::size_t>(state_.size() * state_.size()) * sizeof(double);
    return done;
  }

  std::size_t active() const { return active_; }
  std::size_t inactive() const { return state_.inactive().size(); }

 private:
  static StereoRig rig() {
    StereoRig rig;
    rig.camera = {700.0, 700.0, 600.0, 180.0, 0.54};
    return rig;
  }

  /// With noise; a point that was never seen comes into being.
  StereoFeatureObservation see(FeatureId id) {
    auto point = points_.find(id);
    if (point == points_.end()) {
      const double depth = depth_(engine_);
      point =
          points_.emplace(id, Eigen::Vector3d(0.1 * depth * x_(engine_), 0.1 * depth * y_(engine_), depth))
              .first;
      next_id_ = id + 1;
    }
    const StereoPixels noise(pixel_(engine_), pixel_(engine_), pixel_(engine_), pixel_(engine_));
    return {id, rig().camera.project(point->second) + noise};
  }

  void add(const StereoFeatureObservation& feature) {
    const auto sighting = model_.triangulate(state_, feature.pixels, 1e3);
    state_.addLandmark(feature.id, sighting->position, sighting->covariance);
  }

  void removeOldest(bool keep) {
    const auto& landmarks = state_.landmarks();
    const auto oldest = std::min_element(landmarks.begin(), landmarks.end(),
                                         [](const Landmark& a, const Landmark& b) { return a.id < b.id; });
    points_.erase(oldest->id);
    const auto index = static_cast<std::size_t>(oldest - landmarks.begin());
    if (keep) {
      state_.deactivateLandmark(index);
    } else {
      state_.removeLandmark(index);
    }
  }

  std::size_t active_;
  InvariantConfig config_;
  StereoModel model_;
  State state_;
  std::mt19937 engine_{1};
  std::uniform_real_distribution<double> x_{-8.0, 8.0}, y_{-2.0, 2.0}, depth_{6.0, 60.0};
  std::normal_distribution<double> pixel_{0.0, 0.3};
  std::map<FeatureId, Eigen::Vector3d> points_;
  FeatureId next_id_ = 0;
  std::size_t leaving_ = 0; // the active ones of each frame so far that have not left yet
};

/// Largest resident memory since the last forgetPeak, MB (Linux).
double peakMegabytes() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    double kilobytes = 0.0;
    if (word == "VmHWM:" && status >> kilobytes) return kilobytes / 1024.0;
  }
  return 0.0;
}
void forgetPeak() {
  malloc_trim(0); // what earlier cases left
  std::ofstream("/proc/self/clear_refs") << "5";
}

/// Arguments: landmarks in view, landmarks out of view.
void growth(benchmark::State& run) {
  const auto active = static_cast<std::size_t>(run.range(0)),
             inactive = static_cast<std::size_t>(run.range(1));
  // The cases of as many in view come one after the other, the map growing from one to the next.
  static std::unique_ptr<Scene> scene;
  if (!scene || scene->active() != active || scene->inactive() > inactive) {
    scene.reset();
    scene = std::make_unique<Scene>(active);
  }
  scene->fill(inactive);
  forgetPeak();
  std::vector<double> times;
  std::size_t used = 0, bytes = 0, least = inactive;
  for (auto _ : run) {
    const Frame frame = scene->step(inactive);
    run.SetIterationTime(frame.seconds);
    times.push_back(1e3 * frame.seconds);
    used += frame.used;
    bytes = std::max(bytes, frame.bytes);
    least = std::min(least, scene->inactive());
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
} // namespace vi_ekf_slam::invariant

int main(int argc, char** argv) {
  using vi_ekf_slam::invariant::growth;
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  for (const int active : {25, 50, 100, 200, 400}) {
    benchmark::RegisterBenchmark("growth", growth)
        ->ArgNames({"active", "inactive"})
        ->ArgsProduct({{active}, {0, 500, 1000, 2000, 5000}})
        ->Iterations(static_cast<benchmark::IterationCount>(vi_ekf_slam::invariant::kSightings) / active)
        ->UseManualTime()
        ->Unit(benchmark::kMillisecond);
  }
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
