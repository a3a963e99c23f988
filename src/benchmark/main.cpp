// Of the benchmarks that register themselves.
#include <benchmark/benchmark.h>

#include "vi_ekf_slam/core/run/memory.hpp"

int main(int argc, char** argv) {
  vi_ekf_slam::keepFreedMemory();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
