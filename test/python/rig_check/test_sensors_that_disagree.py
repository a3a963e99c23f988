"""What run_bag says of bags whose sensors do not belong together, of a simulated drive that is changed afterwards."""

import os
import re

import breaking
import genpy
import pytest
import rigs
import rosbag

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.common.geometry import inverse
from vi_ekf_slam.simulation.simulator import main as simulate


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A bag: longer than the rigs of rigs.py, since ten seconds of motion must contradict."""
    folder = tmp_path_factory.mktemp("sound")
    npz, bag = str(folder / "drive.npz"), str(folder / "drive.bag")
    assert simulate([npz, "--quiet", "--seed", "2", "--duration", "30", "--block-length", "60", "--block-width", "40"]) == 0
    assert convert([npz, bag, "--quiet"]) == 0
    return bag


def told_of(sound, folder, change):
    """(exit status, what is said on standard error, names of the files written) of run_bag on the bag as `change` makes it."""
    with rosbag.Bag(sound) as bag:
        entries = [[topic, received, message] for topic, message, received in bag.read_messages()]
    changed, output = rigs.write(str(folder / "changed.bag"), change(entries)), str(folder / "run")
    done = rigs.run_bag(changed, output)
    return done.returncode, done.stderr, os.listdir(output)


def imu_ahead(entries):
    for _, _, message in rigs.of(entries, "/imu"):
        message.header.stamp += genpy.Duration.from_sec(0.5)
    return entries


@pytest.mark.parametrize("change, status, words", [
    (lambda entries: entries, 0, []),
    (breaking.backwards, 0, ["the velocity does not move as the pictures do", "is the velocity backwards"]),
    (lambda entries: breaking.gyro(entries, lambda w: 57.3 * w), 0,
     ["the gyro does not turn as the pictures do", "is the gyro in deg/s?"]),
    (lambda entries: breaking.gyro(entries, lambda w: 0.0 * w), 0,
     ["the gyro does not turn as the pictures do", "is it connected?"]),
    (lambda entries: breaking.extrinsic(entries, inverse(breaking.imu_T_left(entries))), 0,
     ["the gyro does not turn", "the velocity does not move", "is that not inverted?"]),
    (imu_ahead, 2, ["messages were dropped", "0.2 s (buffer/max_delay_s)", "of one clock?"]),
])
def test_sensors_that_disagree_are_named(sound, tmp_path, change, status, words):
    code, said, written = told_of(sound, tmp_path, change)
    assert code == status, said
    assert bool(said) == bool(words), said
    for word in words:
        assert word in said
    assert "trajectory.tum" in written  # what was computed is there


def imu_late(entries):
    """It is received 0.5 s later."""
    for entry in rigs.of(entries, "/imu"):
        entry[1] += genpy.Duration.from_sec(0.5)
    return entries


def imu_restarted(entries):
    """From a third on its clock is 3 s ahead."""
    samples = rigs.of(entries, "/imu")
    for _, _, message in samples[len(samples) // 3:]:
        message.header.stamp += genpy.Duration.from_sec(3.0)
    return entries


@pytest.mark.parametrize("change, dropped", [
    (imu_late, r"gyro: \d+ of \d+ messages were dropped: they come more than 0.2 s \(buffer/max_delay_s\)"),
    (imu_restarted, r"stereo: \d+ of 80 messages were dropped: \d+ have stamps more than 1 s \(buffer/max_jump_s\) away from all others"),
])
def test_what_was_dropped_is_the_problem_and_not_that_nothing_starts_without_it(tmp_path, change, dropped):
    bag = rigs.write(str(tmp_path / "rig.bag"), change(rigs.message_list(rigs.shaken_points())))
    done = rigs.run_bag(bag, str(tmp_path / "run"))
    assert done.returncode == 2
    assert re.search(dropped, done.stderr.splitlines()[-1]), done.stderr
