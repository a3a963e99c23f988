"""Rosrun finds each program of the package exactly once in the devel space that is sourced."""

import os
import shutil
import subprocess

import pytest
from conftest import HANG_S, ROOT, program, script_path

PROGRAMS = ["monte_carlo", "run_bag", "simulate_drive", "slam_node", "soak", "stereo_front_end"]
SCRIPTS = ["check_rig.py", "dataset_to_bag.py", "degraded_bag.py", "evaluate.py", "export_rviz_config.py",
           "import_calibration.py", "load_test.py", "play_bag.py", "plot.py", "publish_calibration.py",
           "record_outputs.py", "render_rviz.py", "reproduce_paper.py",
           "simulate_dataset.py"]
NODES = ["slam_node", "stereo_front_end", "play_bag.py", "publish_calibration.py", "record_outputs.py"]

pytestmark = pytest.mark.skipif(shutil.which("rosrun") is None, reason="NOT RUN: rosrun is not installed")


def devel_space():
    """The space among those sourced that holds the package."""
    for space in os.environ.get("CMAKE_PREFIX_PATH", "").split(os.pathsep):
        if os.path.isfile(os.path.join(space, "lib", "vi_ekf_slam", "run_bag")):
            return os.path.realpath(space)
    pytest.skip("NOT RUN: no space that is sourced holds the programs")


@pytest.fixture(autouse=True)
def space():
    """The devel space; skips where rosrun cannot find programs because setup.sh, which links them, was not used."""
    found = devel_space()
    inside = found.startswith(os.path.join(os.path.realpath(ROOT), "build") + os.sep)
    if inside and not os.path.isdir(os.path.join(ROOT, "bin")):
        pytest.skip("NOT RUN: there is no bin/, because the package was not built by scripts/setup.sh")
    return found


@pytest.mark.parametrize("name", PROGRAMS + SCRIPTS)
def test_it_is_found_once_and_starts(space, tmp_path, name):
    """Nobody answers should rosrun ask which of several is meant. It looks through build/ too, where logs of other tests come and
    go, and complains of those that went."""
    prefix = tmp_path / "say_and_run"
    prefix.write_text('#!/bin/sh\necho "$1"\nexec "$@"\n')
    prefix.chmod(0o755)
    done = subprocess.run(["rosrun", "--prefix", str(prefix), "vi_ekf_slam", name, "--help"], stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, timeout=HANG_S)
    assert done.returncode == 0 and "[rosrun]" not in done.stdout + done.stderr, done.stdout + done.stderr
    found, text = done.stdout.split("\n", 1)
    assert os.path.basename(found) == name and "usage: " in text.lower()
    if name in PROGRAMS:
        assert os.path.realpath(found) == os.path.join(space, "lib", "vi_ekf_slam", name)


@pytest.mark.parametrize("name", NODES)
def test_a_node_takes_no_other_arguments_than_those_of_ros(name):
    done = subprocess.run([program(name), "__name:=other", "_parameter:=1", "file.bag"], stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, timeout=HANG_S)
    assert done.returncode == 2 and not done.stdout
    assert "file.bag" in done.stderr and "usage: " in done.stderr and "_parameter" not in done.stderr


@pytest.mark.parametrize("name", PROGRAMS)
def test_roslaunch_takes_the_program_of_the_devel_space(space, name):
    from roslib.packages import find_node
    assert os.path.realpath(find_node("vi_ekf_slam", name)[0]) == os.path.join(space, "lib", "vi_ekf_slam", name)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_does_not_use_a_python_that_happens_to_be_first_on_the_path(name):
    """That of pyenv, conda or a virtual environment has not the ROS packages."""
    with open(script_path(name), encoding="utf-8") as stream:
        assert stream.readline() == "#!/usr/bin/python3\n"


def test_bin_holds_a_relative_link_to_each_program(space):
    folder = os.path.join(ROOT, "bin")
    if not os.path.isdir(folder) or not space.startswith(os.path.realpath(ROOT) + os.sep):
        pytest.skip("the devel space that is sourced needs no links")
    links = {name: os.readlink(os.path.join(folder, name)) for name in os.listdir(folder)}
    assert sorted(links) == PROGRAMS
    assert not any(os.path.isabs(target) for target in links.values())
