#!/usr/bin/env bash
# Installs what is missing (Debian 12) or uses the ROS that is there (Noetic), then builds into build/ and links the
# programs into bin/, where rosrun looks.
# Does nothing where all is in place. Afterwards: source build/devel/setup.bash
# JOBS=N limits the build to N jobs (default: all cores). CMAKE_OPTIONS="-D..." are given to CMake where it configures.
# MORE_PACKAGES="..." are more Debian packages to install.

set -euo pipefail
# shellcheck source=scripts/environment.sh
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"
no_arguments "$@"

read -r -a cmake_options <<<"${CMAKE_OPTIONS:-}"
packages=(
  build-essential catkin catkin-lint cmake
  libbenchmark-dev libboost-program-options-dev libbz2-dev libcv-bridge-dev libdiagnostic-updater-dev
  libdynamic-reconfigure-config-init-mutex-dev libeigen3-dev libgl1-mesa-dri libgtest-dev libimage-transport-dev libnodelet-dev
  libnodeletlib-dev libnodeletlib-tools libopencv-dev librosbag-dev librosbag-storage-dev libroslz4-dev librostest-dev
  libtf-dev libtf2-dev libtf2-msgs-dev libtf2-ros-dev libyaml-cpp-dev
  python3-diagnostic-msgs python3-dynamic-reconfigure python3-geometry-msgs python3-matplotlib python3-nav-msgs
  python3-numpy python3-opencv python3-pil python3-pytest python3-python-qt-binding python3-rosbag python3-roslaunch python3-rosnode python3-rosparam
  python3-rospy python3-rosservice python3-rostest python3-rostopic python3-rviz python3-scipy
  python3-sensor-msgs python3-setuptools python3-std-srvs python3-tf2-ros python3-tqdm
  python3-visualization-msgs python3-yaml
  ros-base-dev ros-robot-state-publisher rosbash rviz tf-tools tf2-tools xvfb
)
read -r -a more_packages <<<"${MORE_PACKAGES:-}"
packages+=("${more_packages[@]}")

as_root() {
  if [ "$(id -u)" -eq 0 ]; then
    "$@"
  elif command -v sudo >/dev/null; then
    sudo "$@"
  else
    fail "needs root for: $*"
  fi
}

install_debian_packages() {
  local missing=() package
  for package in "${packages[@]}"; do
    [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null || true)" = installed ] || missing+=("$package")
  done
  [ "${#missing[@]}" -eq 0 ] && return
  say "installing ${missing[*]}"
  quietly as_root apt-get -qq update
  quietly as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "${missing[@]}"
}

# A sourced ROS of its own prefix (Noetic on Ubuntu 20.04), which Debian's packages would only confuse.
ros_is_sourced() { [ "${ROS_VERSION:-}" = 1 ] && [ "${ROS_DISTRO:-}" = noetic ]; }

find_ros() {
  local distribution="/opt/ros/${ROS_DISTRO:-noetic}/setup.bash"
  if ros_is_sourced; then
    say "using the ROS $ROS_DISTRO that is sourced"
  elif [ -f "$distribution" ]; then
    say "using $distribution"
    source_unset "$distribution"
  elif grep -qs '^VERSION_CODENAME=bookworm' /etc/os-release; then
    install_debian_packages
  else
    fail "no ROS 1 found: source the setup.bash of ROS Noetic, or use Debian 12, whose packages hold ROS 1." \
      "Dependencies on Noetic: rosdep install --from-paths '$root' --ignore-src"
  fi
}

# Prints the output of a command only if it fails.
quietly() {
  local log="$build/setup.log"
  "$@" >"$log" 2>&1 || {
    cat "$log" >&2
    fail "failed: $*"
  }
}

build_package() {
  if [ ! -f "$build/Makefile" ] && [ ! -f "$build/build.ninja" ]; then
    say "configuring $build"
    quietly cmake -S "$root" -B "$build" -DPYTHON_EXECUTABLE="$python" -DPython3_EXECUTABLE="$python" \
      -DCMAKE_BUILD_TYPE=Release -Dvi_ekf_slam_AVX=ON "${quick_build[@]}" "${cmake_options[@]}"
  fi
  say "building (nothing to do where all is up to date)"
  quietly cmake --build "$build" -j"${JOBS:-$(nproc)}"
}

# Rosrun overlooks what is below a package's own build/ (it finds the scripts in scripts/), so the programs get links in
# bin/. A devel space anywhere else needs none: there the links, which belong to build/, stay as they are.
link_programs() {
  local folder="$root/bin" programs file link target changed=()
  programs="$(cd "$build" && pwd)/devel/lib/vi_ekf_slam"
  case "$programs" in "$root"/build/*) ;; *) return 0 ;; esac
  mkdir -p "$folder"
  for link in "$folder"/*; do
    file="$programs/${link##*/}"
    if [ -L "$link" ] && ! is_program "$file"; then
      rm "$link"
      changed+=("-${link##*/}")
    fi
  done
  for file in "$programs"/*; do
    is_program "$file" || continue
    link="$folder/${file##*/}"
    target="../${file#"$root"/}"
    [ "$(readlink "$link" || true)" != "$target" ] || continue
    [ ! -e "$link" ] || [ -L "$link" ] || fail "$link is in the way: it is to be a link to $target"
    ln -sfn "$target" "$link"
    changed+=("+${file##*/}")
  done
  [ "${#changed[@]}" -eq 0 ] || say "links in bin/ for rosrun: ${changed[*]}"
}

# Whether the file is an executable of the linker's, not a script, and not one of the tests and benchmarks beside the programs.
is_program() {
  case "$1" in *_test | *_benchmark) return 1 ;; esac
  [ -f "$1" ] && [ -x "$1" ] && [ "$(head -c 4 "$1" | tail -c 3)" = ELF ]
}

find_ros
build_package
link_programs
say "ready: source ${build#"$PWD"/}/devel/setup.bash"
