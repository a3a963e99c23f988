/// How long a frame's update takes, beside the dense kernels that it cannot do without: the Cholesky factor
/// of S, one triangular solve for A = P H^T L^-T and P - A A^T, of the same sizes, on the same machine, in
/// turns.

#include <benchmark/benchmark.h>

#include <Eigen/Cholesky>
#include <chrono>

#include "resting_scene.hpp"

namespace vi_ekf_slam {
namespace {

using Clock = std::chrono::steady_clock;

double seconds(Clock::time_point from) { return std::chrono::duration<double>(Clock::now() - from).count(); }

/// Arguments: active landmarks, all of them seen.
void frameUpdate(benchmark::State& run) {
  RestingScene scene(static_cast<std::size_t>(run.range(0)), {});
  scene.advance();
  const StereoFrame frame = scene.look();
  const Eigen::Index n = scene.filter.rows(), m = 3 * static_cast<Eigen::Index>(run.range(0));
  const Eigen::MatrixXd random = Eigen::MatrixXd::Random(m, m);
  const Eigen::MatrixXd S = random * random.transpose() + 10.0 * Eigen::MatrixXd::Identity(m, m);
  const Eigen::MatrixXd PHt = Eigen::MatrixXd::Random(n, m);
  Eigen::MatrixXd P = Eigen::MatrixXd::Zero(n, n);
  Eigen::LLT<Eigen::MatrixXd> llt(m);
  double ours = 0.0, kernels = 0.0;
  std::size_t used = 0;
  for (auto _ : run) {
    Filter filter = scene.filter;
    auto start = Clock::now();
    const FrameOutcome outcome = scene.correct(filter, frame);
    const double took = seconds(start);
    ours += took;
    used = countTrue(outcome.used);
    run.SetIterationTime(took);

    Eigen::MatrixXd A = PHt;
    start = Clock::now();
    llt.compute(S);
    llt.matrixU().solveInPlace<Eigen::OnTheRight>(A);
    P.selfadjointView<Eigen::Lower>().rankUpdate(A, -1.0);
    kernels += seconds(start);
    benchmark::DoNotOptimize(P.data());
  }
  run.counters["rows"] = static_cast<double>(n);
  run.counters["used"] = static_cast<double>(used);
  run.counters["kernels_ms"] = 1e3 * kernels / static_cast<double>(run.iterations());
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
} // namespace vi_ekf_slam
