#!/usr/bin/env bash
# Builds and runs all tests: gtests, rostests, Python tests. The last line counts them: N passed, N failed, N skipped.
# Exits with 1 when a test failed or none ran. TEST_TIMEOUT=S limits the gtests and rostests (default: 1800 s in all).

set -euo pipefail
exec </dev/null
# shellcheck source=scripts/environment.sh
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"
results="$build/test_results"

"$root/scripts/setup.sh"
say "building the tests"
cmake --build "$build" --target tests -j"${JOBS:-$(nproc)}" >"$build/tests.log" 2>&1 || {
  cat "$build/tests.log" >&2
  fail "the tests do not build"
}
source_unset "$build/devel/setup.bash"

rm -rf "$results"  # old results must not count
mkdir -p "$results"
status=0
# Beside the tests with a master, and with less right to the cores, since those have times to keep. In two, so that no
# core waits for the other at the end.
say "running the Python tests in the background"
python_tests() {
  nice "$python" -m pytest "${@:2}" -q -rs -p no:cacheprovider --junitxml="$results/$1.xml" >"$build/$1.log" 2>&1
}
studies="$root/test/python/studies"
python_tests studies "$studies" &
jobs=($!)
python_tests python "$root/test/python" --ignore="$studies" &
jobs+=($!)
say "running gtests and rostests"
if ! timeout --kill-after=30 "${TEST_TIMEOUT:-1800}" cmake --build "$build" --target run_tests -j1; then
  status=1  # a failed test leaves its result; what ended the run itself would leave none
  cat >"$results/run_tests.xml" <<'EOF'
<testsuite><testcase classname="run_tests" name="ends"><failure>ended early or out of time</failure></testcase></testsuite>
EOF
fi
for job in "${jobs[@]}"; do wait "$job" || status=1; done
say "Python tests"
cat "$build/python.log" "$build/studies.log"

"$python" "$root/scripts/count_test_results.py" "$results" || status=1
exit "$status"
