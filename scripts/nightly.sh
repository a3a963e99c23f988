#!/usr/bin/env bash
# What takes too long for every test run:
#   scripts/nightly.sh fuzz [SECONDS [TARGET ...]]     the fuzz targets (libFuzzer, AddressSanitizer, UBSan), SECONDS each (60)
#   scripts/nightly.sh sanitize [address|thread ...]   all gtests with AddressSanitizer and UBSan, then with ThreadSanitizer
#   scripts/nightly.sh soak [FRAMES]                   a million frames of the filter, then FRAMES of 10 Hz (864000, a day) through
#                                                      the node's own input path
#   scripts/nightly.sh rigs                            check_rig.py on recorded rigs that are broken afterwards
#   scripts/nightly.sh plain                           builds all and the tests as catkin_make does, one file at a time, with OpenCV
#                                                      and without
#
# fuzz: targets are estimator, config, messages, bag, map (default: all). What they find new stays in build/fuzz/found/TARGET
# and is taken up again by the next run; an input that breaks something goes to build/fuzz/crash-*. scripts/test.sh only replays
# the corpus (fuzz_*_test), and builds none of the targets.
# sanitize: prints a line a test program. FILTER=PATTERN: gtest's filter. The builds stay in build/sanitize/.
# soak: in one process, as fast as it goes. A line each hour of sensor time; broken is memory that grows by more than 5 % in
# the last third, a number that is none, a pose that is missing. The results stay in build/soak/.
#
# Exits with 1 when something is broken.

set -euo pipefail
exec </dev/null
# shellcheck source=scripts/environment.sh
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"
status=0

# configure FOLDER CXX_FLAGS [CMAKE_OPTION ...], once.
configure() {
  [ ! -f "$1/Makefile" ] && [ ! -f "$1/build.ninja" ] || return 0
  cmake -S "$root" -B "$1" -DPYTHON_EXECUTABLE="$python" -DPython3_EXECUTABLE="$python" -DCMAKE_BUILD_TYPE=None \
    -DCMAKE_CXX_FLAGS="$2" "${quick_build[@]}" "${@:3}"
}

# build_failed LOG WHAT
build_failed() {
  cat "$1" >&2
  fail "$2 do not build"
}

# -- fuzz

build_targets() {
  configure "$1" "-O1 -g1 -fno-omit-frame-pointer" -DCMAKE_CXX_COMPILER=clang++ -Dvi_ekf_slam_FUZZ=ON
  cmake --build "$1" -j"${JOBS:-$(nproc)}" --target "${@:2}"
}

fuzz() {
  local seconds="${1:-60}" folder="$build/fuzz" corpus="$root/test/fuzz/corpus" name
  [[ "$seconds" =~ ^[0-9]+$ ]] || fail "SECONDS is '$seconds', allowed: a whole number"
  shift || true
  [ $# -gt 0 ] || set -- estimator config messages bag map
  for name in "$@"; do
    [ -d "$corpus/$name" ] || fail "unknown target '$name'; known are: estimator, config, messages, bag, map"
  done
  command -v clang++ >/dev/null || MORE_PACKAGES="clang libclang-rt-14-dev" "$root/scripts/setup.sh"
  command -v clang++ >/dev/null || fail "needs clang++: apt-get install clang"
  export UBSAN_OPTIONS="print_stacktrace=1"
  export ASAN_OPTIONS="detect_leaks=1:allocator_may_return_null=0"
  mkdir -p "$folder"
  say "building the fuzz targets ($folder)"
  build_targets "$folder" "${@/%/_fuzzer}" >"$folder/build.log" 2>&1 || build_failed "$folder/build.log" "the fuzz targets"
  for name in "$@"; do
    say "fuzzing $name"
    fuzz_target "$name" "$seconds" "$folder" "$corpus/$name"
  done
}

fuzz_target() {
  local name="$1" folder="$3" log="$3/$1.log" found="$3/found/$1" options
  options=(-max_len=40000 -timeout=20 -rss_limit_mb=1024 -malloc_limit_mb=256 -print_final_stats=1
    -artifact_prefix="$folder/crash-$name-" -max_total_time="$2")
  [ ! -f "$root/test/fuzz/$name.dict" ] || options+=(-dict="$root/test/fuzz/$name.dict")
  mkdir -p "$found"
  # A sourced setup.bash would give it the libraries of another build.
  if env -u LD_LIBRARY_PATH "$folder/devel/lib/vi_ekf_slam/${name}_fuzzer" "${options[@]}" "$found" "$4" >"$log" 2>&1; then
    printf '%s: %s inputs, coverage %s, peak %s MB, nothing broken\n' "$name" \
      "$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")" \
      "$(grep -o 'cov: [0-9]*' "$log" | tail -n 1 | cut -d' ' -f2)" \
      "$(sed -n 's/^stat::peak_rss_mb: *//p' "$log")"
  else
    status=1
    printf '%s: BROKEN, see %s\n' "$name" "$log"
    grep -E '^broken: |ERROR: |runtime error: |SUMMARY: |Test unit written' "$log" | head -n 10 || true
  fi
}

# -- sanitize

declare -A sanitizer_flags=(
  [address]="-fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all"
  [thread]="-fsanitize=thread"
)
# Studies that would take ThreadSanitizer an hour, and have nothing for it to see.
one_thread="simulation_loop_test simulation_map_test simulation_places_test"

# Names of the gtests' targets, without building anything.
gtests_of() {
  cmake --build "$1" --target help | sed -n 's/^.*\b_run_tests_vi_ekf_slam_gtest_\(\w\+\)$/\1/p' | sort
}

build_gtests() {
  local kind="$1" folder="$2" tests
  # Debug information without NDEBUG: Eigen's and our own assertions are checks as well.
  configure "$folder" "-O2 -g1 -fno-omit-frame-pointer ${sanitizer_flags[$kind]}" -Dvi_ekf_slam_AVX=ON
  mapfile -t tests < <(gtests_of "$folder")
  [ "${#tests[@]}" -gt 0 ] || fail "$folder has no gtests: is libgtest-dev installed?"
  cmake --build "$folder" -j"${JOBS:-$(nproc)}" --target "${tests[@]}"
}

run_gtests() {
  local kind="$1" folder="$2" name log start
  for name in $(gtests_of "$folder"); do
    if [ "$kind" = thread ] && [[ " $one_thread " == *" $name "* ]]; then
      printf '%s: %s: built, not run: it has one thread\n' "$kind" "$name"
      continue
    fi
    log="$folder/$name.log"
    start=$SECONDS
    if env -u LD_LIBRARY_PATH "$folder/devel/lib/vi_ekf_slam/$name" ${FILTER:+--gtest_filter="$FILTER"} >"$log" 2>&1; then
      printf '%s: %s: %s, nothing reported, %d s\n' "$kind" "$name" "$(grep -o '[0-9]* tests\? from .* ran' "$log")" \
        $((SECONDS - start))
    else
      status=1
      printf '%s: %s: FAILED, see %s\n' "$kind" "$name" "$log"
      grep -E 'ERROR: |WARNING: ThreadSanitizer|runtime error: |SUMMARY: |FAILED  ]' "$log" | head -n 20 || true
    fi
  done
}

sanitize() {
  local suppressions="$root/test/sanitizers" kind folder
  [ $# -gt 0 ] || set -- address thread
  for kind in "$@"; do
    [ -n "${sanitizer_flags[$kind]:-}" ] || fail "unknown sanitizer '$kind'; known are: ${!sanitizer_flags[*]}"
  done
  export ASAN_OPTIONS="detect_stack_use_after_return=1:strict_string_checks=1:allocator_may_return_null=0"
  export LSAN_OPTIONS="suppressions=$suppressions/leaks.txt:print_suppressions=0"
  export UBSAN_OPTIONS="print_stacktrace=1"
  export TSAN_OPTIONS="suppressions=$suppressions/threads.txt:print_suppressions=0:halt_on_error=1"
  "$root/scripts/setup.sh"
  for kind in "$@"; do
    folder="$build/sanitize/$kind"
    mkdir -p "$folder"
    say "building the gtests with $kind ($folder)"
    build_gtests "$kind" "$folder" >"$folder/build.log" 2>&1 || build_failed "$folder/build.log" "with $kind the tests"
    run_gtests "$kind" "$folder"
  done
  [ "$status" -ne 0 ] || say "the sanitizers have nothing to report"
}

# -- soak

soak() {
  "$root/scripts/setup.sh"
  mkdir -p "$build/soak"
  say "building core_endurance_test"
  cmake --build "$build" --target core_endurance_test >"$build/soak/build.log" 2>&1 || build_failed "$build/soak/build.log" "its tests"
  "$build/devel/lib/vi_ekf_slam/core_endurance_test" --gtest_also_run_disabled_tests
  exec "$build/devel/lib/vi_ekf_slam/soak" --frames "${1:-864000}" --output "$build/soak"
}

# -- rigs

rigs() {
  "$root/scripts/setup.sh"
  source_unset "$build/devel/setup.bash"
  "$python" -m pytest -q -rs -p no:cacheprovider "$root/test/python/rig_check/nightly_recorded_rigs.py" || status=1
}

# -- plain

# setup.sh compiles a dozen files as one, where an include that is missing in one of them is not missed.
plain() {
  local -A options=([with_opencv]="-DCMAKE_DISABLE_FIND_PACKAGE_OpenCV=OFF" [without_opencv]="-DCMAKE_DISABLE_FIND_PACKAGE_OpenCV=ON")
  local kind folder
  "$root/scripts/setup.sh"
  for kind in with_opencv without_opencv; do
    folder="$build/plain/$kind"
    mkdir -p "$folder"
    say "building $kind ($folder)"
    if cmake -S "$root" -B "$folder" -DPYTHON_EXECUTABLE="$python" -DPython3_EXECUTABLE="$python" -DCMAKE_BUILD_TYPE=Release \
      "${options[$kind]}" >"$folder/build.log" 2>&1 \
      && cmake --build "$folder" -j"${JOBS:-$(nproc)}" --target all tests >>"$folder/build.log" 2>&1; then
      printf '%s: built\n' "$kind"
    else
      status=1
      printf '%s: FAILED, see %s\n' "$kind" "$folder/build.log"
      grep -E 'error:|undefined reference' "$folder/build.log" | head -n 10 || true
    fi
  done
}

case "${1:-}" in
  fuzz) fuzz "${@:2}" ;;
  sanitize) sanitize "${@:2}" ;;
  soak) soak "${@:2}" ;;
  rigs) rigs ;;
  plain) plain ;;
  *) fail "usage: scripts/nightly.sh fuzz|sanitize|soak|rigs|plain [...], see --help" ;;
esac
exit "$status"
