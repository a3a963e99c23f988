# shellcheck shell=bash
# Sourced by setup.sh, demo.sh, test.sh and nightly.sh: where things are, and an environment that asks nothing of the caller's.
# BUILD_DIR=DIR builds there instead of in build/.

# --help prints the comment at the head of the script, before anything is built or run.
case " $* " in
  *" --help "* | *" -h "*)
    sed -n '2,/^[^#]/s/^# \{0,1\}//p' "${BASH_SOURCE[1]}"
    exit 0
    ;;
esac

root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
build="${BUILD_DIR:-$root/build}"
# shellcheck disable=SC2034
python=/usr/bin/python3  # the system's: ROS packages are not in anybody's virtual environment

export PATH="/usr/bin:$PATH"  # the same holds for scripts that begin with `env python3`
[ -w "${HOME:-}" ] || export HOME="$build/home"
export ROS_HOME="$build/ros_home"
export ROS_LOG_DIR="$build/ros_home/log"
export MPLCONFIGDIR="$build/matplotlib"
export MPLBACKEND=Agg
mkdir -p "$HOME" "$ROS_LOG_DIR" "$MPLCONFIGDIR"

# What takes most of the time to compile, Eigen's templates, is the same in all files: a dozen at a time, of headers
# that are compiled once.
# shellcheck disable=SC2034
quick_build=(-DCMAKE_UNITY_BUILD=ON -DCMAKE_UNITY_BUILD_BATCH_SIZE=12 -Dvi_ekf_slam_PRECOMPILED_HEADERS=ON)

say() { printf '== %s\n' "$*"; }

fail() {
  printf 'error: %s\n' "$*" >&2
  exit 1
}

# Arguments that would be overlooked are refused.
no_arguments() { [ "$#" -eq 0 ] || fail "${0##*/} takes no arguments, given: $*; see --help"; }

# Catkin's setup files read variables that are not set.
source_unset() {
  set +u
  # shellcheck disable=SC1090
  source "$1"
  set -u
}
