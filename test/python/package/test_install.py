"""The install space: installed elsewhere and sourced alone, it runs a bag through slam.launch."""

import os
import socket
import subprocess

import pytest
from conftest import HANG_S, program

OF_A_SPACE = ("CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PKG_CONFIG_PATH", "PYTHONPATH", "ROSLISP_PACKAGE_DIRECTORIES",
              "ROS_PACKAGE_PATH")  # what sourcing one sets


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The prefix of an installation of the build that is sourced, below a folder of its own."""
    build = os.path.dirname(os.path.dirname(os.path.dirname(os.path.dirname(os.path.realpath(program("run_bag"))))))
    if not os.path.isfile(os.path.join(build, "cmake_install.cmake")):
        pytest.skip("NOT RUN: the space that is sourced is no devel space of a build of this package alone")
    root = str(tmp_path_factory.mktemp("installation"))
    subprocess.run(["cmake", "--install", build], env=dict(os.environ, DESTDIR=root), stdout=subprocess.DEVNULL, check=True,
                   timeout=HANG_S)
    return next(folder for folder, _, names in os.walk(root) if "setup.bash" in names)


def in_installation(prefix, command, *arguments):
    """The finished process of a command of bash's, with nothing but the installation sourced."""
    environment = {key: value for key, value in os.environ.items() if key not in OF_A_SPACE}
    return subprocess.run(["bash", "-c", 'source "$0/setup.bash" && ' + command, prefix] + [str(a) for a in arguments],
                          env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True,
                          timeout=HANG_S)


def test_nothing_of_the_devel_space_is_found(installed):
    done = in_installation(installed, "rospack find vi_ekf_slam && "
                                      "python3 -c 'import vi_ekf_slam; print(vi_ekf_slam.__file__)'")
    assert done.returncode == 0 and all(line.startswith(installed) for line in done.stdout.split()), done.stdout


@pytest.mark.parametrize("kind", ["false", "true"])
def test_a_bag_is_played_to_node_and_nodelet(installed, bag, tmp_path, kind):
    """With the programs, scripts, launch files, configuration and plugins that were installed."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    out = tmp_path / "out"
    done = in_installation(installed, 'roslaunch -p "$1" vi_ekf_slam slam.launch bag:="$2" output_dir:="$3" nodelet:="$4"',
                           port, bag, out, kind)
    assert done.returncode == 0 and "has died" not in done.stdout, done.stdout
    expected = tmp_path / "expected"
    again = in_installation(installed, 'rosrun vi_ekf_slam run_bag "$1" --output "$2" --quiet', bag, expected)
    assert again.returncode == 0, again.stdout
    assert (out / "trajectory.tum").read_bytes() == (expected / "trajectory.tum").read_bytes()
