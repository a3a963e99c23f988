#!/usr/bin/env bash
# Runs the fuzz targets (libFuzzer, AddressSanitizer, UBSan), SECONDS each: scripts/fuzz.sh [SECONDS [TARGET ...]]
# For the night: scripts/test.sh only replays the corpus (fuzz_*_test), and builds none of the targets.
# Targets: estimator, config, messages, bag, map (default: all, 60 s each). What they find new stays in build/fuzz/found/TARGET and is
# taken up again by the next run; an input that breaks something goes to build/fuzz/crash-* and makes the exit code 1.

set -euo pipefail
exec </dev/null
# shellcheck source=scripts/environment.sh
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"
seconds="${1:-60}"
[[ "$seconds" =~ ^[0-9]+$ ]] || fail "SECONDS is '$seconds', allowed: a whole number"
shift || true
[ $# -gt 0 ] || set -- estimator config messages bag map
folder="$build/fuzz"
corpus="$root/test/fuzz/corpus"

build_targets() {
  if [ ! -f "$folder/Makefile" ] && [ ! -f "$folder/build.ninja" ]; then
    cmake -S "$root" -B "$folder" -DPYTHON_EXECUTABLE="$python" -DPython3_EXECUTABLE="$python" \
      -DCMAKE_CXX_COMPILER=clang++ -DCMAKE_BUILD_TYPE=None -DCMAKE_CXX_FLAGS="-O1 -g1 -fno-omit-frame-pointer" \
      -Dvi_ekf_slam_FUZZ=ON "${unity_build[@]}"
  fi
  cmake --build "$folder" -j"${JOBS:-$(nproc)}" --target "${@/%/_fuzzer}"
}

export UBSAN_OPTIONS="print_stacktrace=1"
export ASAN_OPTIONS="detect_leaks=1:allocator_may_return_null=0"

mkdir -p "$folder"
for name in "$@"; do
  [ -d "$corpus/$name" ] || fail "unknown target '$name'; known are: estimator, config, messages, bag, map"
done
command -v clang++ >/dev/null || fail "needs clang++: on Debian 12 setup.sh installs it, elsewhere: apt-get install clang"
say "building the fuzz targets ($folder)"
build_targets "$@" >"$folder/build.log" 2>&1 || {
  cat "$folder/build.log" >&2
  fail "the fuzz targets do not build"
}

status=0
for name in "$@"; do
  found="$folder/found/$name"
  options=(-max_len=40000 -timeout=20 -rss_limit_mb=1024 -malloc_limit_mb=256 -print_final_stats=1
    -artifact_prefix="$folder/crash-$name-" -max_total_time="$seconds")
  [ ! -f "$root/test/fuzz/$name.dict" ] || options+=(-dict="$root/test/fuzz/$name.dict")
  mkdir -p "$found"
  say "fuzzing $name"
  # A sourced setup.bash would give it the libraries of another build.
  if env -u LD_LIBRARY_PATH "$folder/devel/lib/vi_ekf_slam/${name}_fuzzer" "${options[@]}" "$found" "$corpus/$name" >"$folder/$name.log" 2>&1; then
    printf '%s: %s inputs, coverage %s, peak %s MB, nothing broken\n' "$name" \
      "$(sed -n 's/^stat::number_of_executed_units: *//p' "$folder/$name.log")" \
      "$(grep -o 'cov: [0-9]*' "$folder/$name.log" | tail -n 1 | cut -d' ' -f2)" \
      "$(sed -n 's/^stat::peak_rss_mb: *//p' "$folder/$name.log")"
  else
    status=1
    printf '%s: BROKEN, see %s\n' "$name" "$folder/$name.log"
    grep -E '^broken: |ERROR: |runtime error: |SUMMARY: |Test unit written' "$folder/$name.log" | head -n 10 || true
  fi
done
exit "$status"
