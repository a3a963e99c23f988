"""What slam.launch makes of its arguments, without running it."""

import os

import pytest
import rosbag
import rospy
from roslaunch.config import load_config_default
from sensor_msgs.msg import Imu

LAUNCH = os.path.join(os.path.dirname(__file__), "..", "..", "..", "launch", "slam.launch")


def required(*arguments):
    """{node: whether the launch ends with it}."""
    config = load_config_default([(os.path.abspath(LAUNCH), list(arguments))], None)
    return {node.name: node.required for node in config.nodes}


@pytest.mark.parametrize("kind", ["false", "true"])
@pytest.mark.parametrize("front_end", ["false", "true"])
def test_only_a_bag_makes_nodes_required(tmp_path, kind, front_end):
    path = str(tmp_path / "drive.bag")
    with rosbag.Bag(path, "w") as bag:  # which the launch file looks into
        bag.write("/imu", Imu(), rospy.Time(1))
    kinds = "nodelet:=" + kind, "front_end:=" + front_end
    with_bag, live = required("bag:=" + path, *kinds), required(*kinds)
    ours = {"slam"} | ({"front_end"} if front_end == "true" else set())
    assert {name for name, is_required in with_bag.items() if is_required} == ours | {"play_bag"}
    assert ours <= set(live) and "play_bag" not in live and not any(live.values())


@pytest.mark.parametrize("kind", ["false", "true"])
def test_all_that_computes_is_started_again_where_that_is_asked_for(kind):
    config = load_config_default([(os.path.abspath(LAUNCH), ["nodelet:=" + kind, "front_end:=true", "respawn:=true"])], None)
    assert {node.name for node in config.nodes if node.respawn} == {"slam", "front_end"} | ({"slam_manager"} if kind == "true" else set())
