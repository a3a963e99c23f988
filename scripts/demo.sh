#!/usr/bin/env bash
# Runs the whole chain without a screen: set up, dataset, bag, launch, picture.
#
#   scripts/demo.sh [DATASET.npz | FOLDER | --images] [OUTPUT_DIR]
#
# Without a dataset one is simulated, with --images one that has pictures. A FOLDER is one that dataset_to_bag.py takes:
# EuRoC, TUM-VI, KITTI. A truth DATASET_truth_left_camera.txt beside an .npz is used. The output goes to demo_output/NAME
# unless told otherwise; what is there and still fits is used again.
# CONFIG=FILE chooses the configuration (default: the launch file's), RATE=N the playback rate (default: 4, pictures 1).

set -euo pipefail
# shellcheck source=scripts/environment.sh
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

usage="usage: scripts/demo.sh [DATASET.npz | FOLDER | --images] [OUTPUT_DIR], see --help"
[ "$#" -le 2 ] || fail "$usage"
images=""
case "${1:-}" in
  --images)
    images=yes
    dataset=""
    ;;
  -*) fail "$usage" ;;
  *) dataset="${1:-}" ;;
esac
[ -z "$dataset" ] || [ -e "$dataset" ] || fail "$dataset: no such file or folder"
case "$dataset" in *.bag) fail "$dataset: is a bag already, play it by: roslaunch vi_ekf_slam slam.launch bag:=$dataset" ;; esac
[[ "${RATE:-1}" =~ ^([0-9]+[.]?|[0-9]*[.][0-9]+)$ && "${RATE:-1}" =~ [1-9] ]] || fail "RATE is '$RATE', allowed: a positive number"
name="simulated${images:+_images}"
[ -z "$dataset" ] || name="$(basename "$(realpath "$dataset")" .npz)"
output="${2:-$root/demo_output/$name}"

"$root/scripts/setup.sh"
source_unset "$build/devel/setup.bash"
[ -z "${CONFIG:-}" ] || "$build/devel/lib/vi_ekf_slam/run_bag" --check --config "$CONFIG" >/dev/null || fail "CONFIG cannot be used"
mkdir -p "$output"
output="$(cd "$output" && pwd)"

# is_current PATH KEY: whether PATH was made from what KEY stands for.
is_current() { [ -e "$1" ] && [ "$(cat "$1.key" 2>/dev/null)" = "$2" ]; }
# Of files their bytes; of what is in a folder names, sizes and times, since pictures are many.
content() {
  local path
  for path in "$@"; do
    if [ -d "$path" ]; then find "$path" -type f -printf '%P %s %T@\n' | sort; else cat "$path"; fi
  done | sha256sum | cut -d' ' -f1
}

if [ -n "$images" ]; then
  dataset="$output/$name"
  key="$(content "$root"/src/vi_ekf_slam/simulation/pictures/*.py)"
  if is_current "$dataset" "$key"; then
    say "using $dataset again"
  else
    say "drawing a drive"
    rm -rf "$dataset"
    "$python" "$root/scripts/simulate_dataset.py" "$dataset" --images
    printf '%s' "$key" >"$dataset.key"
  fi
elif [ -z "$dataset" ]; then
  dataset="$output/$name.npz"
  key="$(content "$build/devel/lib/vi_ekf_slam/simulate_drive" "$root/src/vi_ekf_slam/simulation/simulator.py" "$root/scripts/demo.sh")"
  if is_current "$dataset" "$key"; then
    say "using $dataset again"
  else
    say "simulating a drive"
    # What is passed again is recognised by its ids, so that the second lap closes the loop.
    "$python" "$root/scripts/simulate_dataset.py" "$dataset" --ids-return true --strength-spread 3
    printf '%s' "$key" >"$dataset.key"
  fi
fi

truth="${dataset%.npz}_truth_left_camera.txt"
sources=("$dataset")
convert=("$python" "$root/scripts/dataset_to_bag.py" "$dataset" "$output/$name.bag")
if [ ! -f "$dataset" ] || [ ! -f "$truth" ]; then truth=""; fi
if [ -n "$truth" ]; then
  sources+=("$truth")
  convert+=(--truth "$truth")
fi
key="$(content "${sources[@]}" "$root"/src/vi_ekf_slam/{,*/}*.py)"
if is_current "$output/$name.bag" "$key"; then
  say "using $output/$name.bag again"
else
  say "converting to $output/$name.bag"
  "${convert[@]}"
  printf '%s' "$key" >"$output/$name.bag.key"
fi

# A master of our own, so that nobody else's is disturbed.
port="$("$python" - <<'EOF'
import socket
for port in (11311, 0):
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("", port))
        except OSError:
            continue
        print(probe.getsockname()[1])
        break
EOF
)"
export ROS_MASTER_URI="http://localhost:$port" ROS_HOSTNAME=localhost
unset ROS_IP

launch=""
stop_launch() {
  [ -n "$launch" ] || return 0
  kill -TERM "$launch" 2>/dev/null || true
  wait "$launch" 2>/dev/null || true
}
trap stop_launch EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

default_rate=4
pictures=()
if [ -d "$dataset" ]; then
  default_rate=1
  pictures=(front_end:=true image_transport:=compressed)
fi
run="$output/run"
log="$output/launch.log"
rm -rf "$run"
mkdir -p "$run"
arguments=("bag:=$output/$name.bag" record:=true "output_dir:=$run" "rate:=${RATE:-$default_rate}")
arguments+=("${pictures[@]}")
[ -z "${CONFIG:-}" ] || arguments+=("config:=$(realpath "$CONFIG")")
say "playing the bag through the node (log: $log)"
roslaunch -p "$port" vi_ekf_slam slam.launch "${arguments[@]}" >"$log" 2>&1 </dev/null &
launch=$!
wait "$launch" || {
  status=$?
  tail -n 30 "$log" >&2
  fail "roslaunch ended with status $status"
}
launch=""
[ -s "$run/trajectory.tum" ] || {
  tail -n 30 "$log" >&2
  fail "the node left no trajectory in $run"
}

picture="$output/$name.png"
plot=("$python" "$root/scripts/plot.py" run "$run" --bag "$output/$name.bag" --name "$name" --output "$picture")
[ -z "$truth" ] || plot+=(--truth "$truth")
say "result"
"${plot[@]}"
# What rviz shows of it. All that is missing without rviz or a virtual screen is this picture.
view="$output/${name}_rviz.png"
rm -f "$view"
if command -v Xvfb >/dev/null && "$python" -c 'from rviz import bindings' 2>/dev/null; then
  say "playing the outputs into rviz"
  "$python" "$root/scripts/render_rviz.py" "$run/outputs.bag" "$view" --view top --rate 8 --quiet
else
  say "NO PICTURE FROM RVIZ: Xvfb or rviz's Python module is missing (Debian: xvfb python3-rviz)"
  view="none"
fi
printf 'dataset: %s\nbag:     %s\nresults: %s\npicture: %s\nrviz:    %s\n' "$dataset" "$output/$name.bag" "$run" \
  "$picture" "$view"
