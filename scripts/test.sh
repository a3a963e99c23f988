#!/usr/bin/env bash
# Builds and runs all tests: gtests, rostests, Python tests. The last line counts them: N passed, N failed, N skipped.
# Exits with 1 when a test failed or none ran. TEST_TIMEOUT=S limits the gtests, and the rostests (default: 1800 s each).

set -euo pipefail
exec </dev/null
# shellcheck source=scripts/environment.sh
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"
no_arguments "$@"
results="$build/test_results"

"$root/scripts/setup.sh"
say "building the tests"
cmake --build "$build" --target tests -j"${JOBS:-$(nproc)}" >"$build/tests.log" 2>&1 || {
  cat "$build/tests.log" >&2
  fail "the tests do not build"
}
source_unset "$build/devel/setup.bash"

# What one interpreter compiles the hundreds of others need not, even where PYTHONDONTWRITEBYTECODE is set.
export PYTHONPYCACHEPREFIX="$build/.pycache" PYTHONDONTWRITEBYTECODE=

rm -rf "$results"  # old results must not count
mkdir -p "$results"
status=0
# Rostests mostly wait, so that two run at once, each with a master of its own, and all the others beside them, with less
# right to the cores, since those have times to keep; in three, so that no core waits for another at the end.
names=() jobs=()
in_background() {
  nice "${@:2}" >"$build/$1.log" 2>&1 &
  names+=("$1")
  jobs+=($!)
}
python_tests() {
  in_background "$1" "$python" -m pytest "${@:2}" -q -rs -p no:cacheprovider --junitxml="$results/$1.xml"
}
limited=(timeout --kill-after=30 "${TEST_TIMEOUT:-1800}" cmake --build "$build" --target)
# A failed test leaves its result; what ended the run itself would leave none.
note_failure() {
  status=1
  case "$1" in
    python | studies) ;;
    *) printf '<testsuite><testcase classname="%s" name="ends"><failure>ended early or out of time</failure></testcase></testsuite>\n' \
      "$1" >"$results/$1.xml" ;;
  esac
}
# Divided so that both take about the same time: the last one to end has a core to itself and leaves the other idle.
tests="$root/test/python"
with_studies=("$tests/studies" "$tests/paper" "$tests/bag")
say "running the gtests and the Python tests in the background"
python_tests studies "${with_studies[@]}"
python_tests python "$tests" "${with_studies[@]/#/--ignore=}"
in_background gtests "${limited[@]}" run_tests_vi_ekf_slam_gtest -j1
say "running the rostests"
"${limited[@]}" run_tests_vi_ekf_slam_rostest -j2 || note_failure rostests
"${limited[@]}" run_tests_vi_ekf_slam_roslaunch-check -j1 || note_failure roslaunch_check
for i in "${!jobs[@]}"; do
  wait "${jobs[$i]}" || note_failure "${names[$i]}"
  say "${names[$i]}"
  cat "$build/${names[$i]}.log"
done

"$python" "$root/scripts/count_test_results.py" "$results" || status=1
exit "$status"
