"""What run_bag says of bags whose sensors do not belong together, of a simulated drive that is changed afterwards."""

import os
import subprocess

import pytest
import rosbag
import rospy
from conftest import HANG_S, program
from geometry_msgs.msg import Vector3

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.simulation.simulator import main as simulate


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound")
    npz, bag = str(folder / "drive.npz"), str(folder / "drive.bag")
    assert simulate([npz, "--quiet", "--seed", "2", "--duration", "30", "--block-length", "60", "--block-width", "40"]) == 0
    assert convert([npz, bag, "--quiet"]) == 0
    return bag


def told_of(sound, folder, change):
    """(exit status, what is said on standard error, names of the files written) of run_bag on the bag changed by change(topic, message)."""
    changed, output = str(folder / "changed.bag"), str(folder / "run")
    with rosbag.Bag(sound) as bag, rosbag.Bag(changed, "w") as out:
        for topic, message, received in bag.read_messages():
            change(topic, message)
            out.write(topic, message, received)
    done = subprocess.run([program("run_bag"), changed, "--output", output, "--quiet"], stdout=subprocess.DEVNULL,
                          stderr=subprocess.PIPE, universal_newlines=True, timeout=HANG_S, check=False)
    return done.returncode, done.stderr, os.listdir(output)


def as_it_is(topic, message):
    del topic, message


def backwards(topic, message):
    if topic == "/velocity":
        message.twist.twist.linear.x *= -1.0


def in_degrees(topic, message):
    if topic == "/imu":
        for axis in "xyz":
            setattr(message.angular_velocity, axis, 57.3 * getattr(message.angular_velocity, axis))


def without_turns(topic, message):
    if topic == "/imu":
        message.angular_velocity = Vector3()


def inverted(topic, message):
    if topic == "/tf_static":
        for transform in message.transforms:
            transform.transform.rotation.w *= -1.0  # the conjugate


def on_another_clock(topic, message):
    if topic == "/imu":
        message.header.stamp += rospy.Duration(0.5)


@pytest.mark.parametrize("change, status, words", [
    (as_it_is, 0, []),
    (backwards, 0, ["the velocity does not move as the pictures do", "is the velocity backwards"]),
    (in_degrees, 0, ["the gyro does not turn as the pictures do", "is the gyro in deg/s?"]),
    (without_turns, 0, ["the gyro does not turn as the pictures do", "is it connected?"]),
    (inverted, 0, ["the gyro does not turn", "the velocity does not move", "is that not inverted?"]),
    (on_another_clock, 2, ["messages were dropped", "0.2 s (buffer/max_delay_s)", "of one clock?"]),
])
def test_sensors_that_disagree_are_named(sound, tmp_path, change, status, words):
    code, said, written = told_of(sound, tmp_path, change)
    assert code == status, said
    assert bool(said) == bool(words), said
    for word in words:
        assert word in said
    assert "trajectory.tum" in written  # what was computed is there
