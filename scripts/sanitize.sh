#!/usr/bin/env bash
# Builds all gtests with AddressSanitizer and UndefinedBehaviorSanitizer, then with ThreadSanitizer, and runs them.
# Prints a line a test program; exits with 1 when one fails or a sanitizer reports anything.
# scripts/sanitize.sh [address|thread ...]: only these. FILTER=PATTERN: gtest's filter. The builds stay in build/sanitize/.

set -euo pipefail
exec </dev/null
# shellcheck source=scripts/environment.sh
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"
suppressions="$root/test/sanitizers"

# Debug information without NDEBUG: Eigen's and our own assertions are checks as well.
common="-O2 -g1 -fno-omit-frame-pointer"
declare -A flags=(
  [address]="-fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all"
  [thread]="-fsanitize=thread"
)
# Studies that would take ThreadSanitizer an hour, and have nothing for it to see.
one_thread="simulation_loop_test simulation_map_test simulation_places_test"
export ASAN_OPTIONS="detect_stack_use_after_return=1:strict_string_checks=1:allocator_may_return_null=0"
export LSAN_OPTIONS="suppressions=$suppressions/leaks.txt:print_suppressions=0"
export UBSAN_OPTIONS="print_stacktrace=1"
export TSAN_OPTIONS="suppressions=$suppressions/threads.txt:print_suppressions=0:halt_on_error=1"

# Names of the gtests' targets, without building anything.
gtests_of() {
  cmake --build "$1" --target help | sed -n 's/^.*\b_run_tests_vi_ekf_slam_gtest_\(\w\+\)$/\1/p' | sort
}

build_gtests() {
  local kind="$1" folder="$2" tests
  mkdir -p "$folder"
  if [ ! -f "$folder/Makefile" ] && [ ! -f "$folder/build.ninja" ]; then
    cmake -S "$root" -B "$folder" -DPYTHON_EXECUTABLE="$python" -DPython3_EXECUTABLE="$python" \
      -DCMAKE_BUILD_TYPE=None -DCMAKE_CXX_FLAGS="$common ${flags[$kind]}" \
      -Dvi_ekf_slam_AVX=ON "${unity_build[@]}"
  fi
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

status=0
[ $# -gt 0 ] || set -- address thread
"$root/scripts/setup.sh"
for kind in "$@"; do
  [ -n "${flags[$kind]:-}" ] || fail "unknown sanitizer '$kind'; known are: ${!flags[*]}"
  folder="$build/sanitize/$kind"
  mkdir -p "$folder"
  say "building the gtests with $kind ($folder)"
  build_gtests "$kind" "$folder" >"$folder/build.log" 2>&1 || {
    cat "$folder/build.log" >&2
    fail "the tests do not build with $kind"
  }
  run_gtests "$kind" "$folder"
done
[ "$status" -eq 0 ] && say "the sanitizers have nothing to report"
exit "$status"
