/// How long a frame's update takes, beside the dense kernels that it cannot do without: the Cholesky factor
/// of S, one triangular solve for A = P H^T L^-T and P - A A^T, of the same sizes, on the same machine, in
/// turns.

#include <benchmark/benchmark.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <chrono>
#include <cmath>
#include <random>

#include "vi_ekf_slam/core/frame_update.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using Clock = std::chrono::steady_clock;

/// A state that has seen `landmarks` points for some frames, and the next frame of them all.
struct Scene {
  explicit Scene(std::size_t landmarks)
      : model(rig(), config.pixel_sigma, config.min_depth_m),
        state({Vector6d::Constant(1e-6), config.prior_twist_sigma, config.prior_bias_sigma}) {
    std::mt19937 engine(1);
    std::uniform_real_distribution<double> x(-8.0, 8.0), y(-2.0, 2.0), z(6.0, 60.0);
    std::normal_distribution<double> pixel(0.0, 0.3);
    for (std::size_t i = 0; i < landmarks; ++i) {
      const double depth = z(engine);
      points.emplace_back(0.1 * depth * x(engine), 0.1 * depth * y(engine), depth);
    }
    const auto observe = [&](const SE3& cam_T_world) {
      StereoFrame seen;
      for (std::size_t i = 0; i < points.size(); ++i) {
        const StereoPixels noise(pixel(engine), pixel(engine), pixel(engine), pixel(engine));
        seen.features.push_back({i, rig().camera.project(cam_T_world * points[i]) + noise});
      }
      return seen;
    };
    frame = observe(SE3());
    for (const StereoFeatureObservation& feature : frame.features) {
      const auto sighting = model.triangulate(state, feature.pixels, 1e3);
      state.addLandmark(feature.id, sighting->position, sighting->covariance);
    }
    const ProcessNoise noise{config.twist_density, config.bias_density};
    for (int k = 0; k < 5; ++k) {
      state.propagate(0.1, noise);
      frame = observe(SE3());
      FrameUpdate(config, model).apply(state, frame, observations(), {});
    }
    state.propagate(0.1, noise);
    frame = observe(SE3());
  }

  static StereoRig rig() {
    StereoRig rig;
    rig.camera = {700.0, 700.0, 600.0, 180.0, 0.54};
    return rig;
  }

  std::vector<Observation> observations() const {
    std::vector<Observation> all;
    for (std::size_t i = 0; i < frame.features.size(); ++i) {
      auto observation = model.observe(state, i, frame.features[i].pixels);
      observation->feature = i;
      all.push_back(*observation);
    }
    return all;
  }

  InvariantConfig config;
  StereoModel model;
  State state;
  std::vector<Eigen::Vector3d> points;
  StereoFrame frame;
};

double seconds(Clock::time_point from) { return std::chrono::duration<double>(Clock::now() - from).count(); }

/// Arguments: active landmarks, all of them seen.
void frameUpdate(benchmark::State& run) {
  const Scene scene(static_cast<std::size_t>(run.range(0)));
  const Eigen::Index n = scene.state.size(), m = 3 * static_cast<Eigen::Index>(run.range(0));
  const Eigen::MatrixXd random = Eigen::MatrixXd::Random(m, m);
  const Eigen::MatrixXd S = random * random.transpose() + 10.0 * Eigen::MatrixXd::Identity(m, m);
  const Eigen::MatrixXd PHt = Eigen::MatrixXd::Random(n, m);
  Eigen::MatrixXd P = Eigen::MatrixXd::Zero(n, n);
  Eigen::LLT<Eigen::MatrixXd> llt(m);
  double ours = 0.0, kernels = 0.0;
  std::size_t used = 0;
  for (auto _ : run) {
    State state = scene.state;
    auto start = Clock::now();
    const FrameOutcome outcome =
        FrameUpdate(scene.config, scene.model).apply(state, scene.frame, scene.observations(), {});
    const double took = seconds(start);
    ours += took;
    used = static_cast<std::size_t>(std::count(outcome.used.begin(), outcome.used.end(), true));
    run.SetIterationTime(took);

    Eigen::MatrixXd A = PHt;
    start = Clock::now();
    llt.compute(S);
    llt.matrixU().solveInPlace<Eigen::OnTheRight>(A);
    P.selfadjointView<Eigen::Lower>().rankUpdate(A, -1.0);
    kernels += seconds(start);
    benchmark::DoNotOptimize(P.data());
  }
  const auto iterations = static_cast<double>(run.iterations());
  run.counters["rows"] = static_cast<double>(n);
  run.counters["used"] = static_cast<double>(used);
  run.counters["kernels_ms"] = 1e3 * kernels / iterations;
  run.counters["ratio"] = ours / kernels;
}

BENCHMARK(frameUpdate)
    ->Arg(25)
    ->Arg(50)
    ->Arg(75)
    ->Arg(100)
    ->Arg(200)
    ->Arg(400)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

} // namespace
} // namespace vi_ekf_slam::invariant

int main(int argc, char** argv) {
#ifdef __GLIBC__
  // The kernels ask for memory to pack what they multiply, and are not to be slower for the pages of it.
  mallopt(M_TRIM_THRESHOLD, 64 << 20);
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
#endif
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
