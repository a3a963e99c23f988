"""What slam.launch makes of its arguments, without running it."""

import os
import shlex
import shutil

import pytest
import rosbag
import rospy
from roslaunch.config import load_config_default
from sensor_msgs.msg import Imu

from vi_ekf_slam.ros.output_recorder import OutputRecorder

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


ROOT = os.path.dirname(os.path.dirname(os.path.abspath(LAUNCH)))


def loaded(*arguments):
    """(parameters {name: value}, {node: its arguments as its process gets them}) of a launch."""
    config = load_config_default([(os.path.abspath(LAUNCH), list(arguments))], None)
    return {name: param.value for name, param in config.params.items()}, {node.name: shlex.split(node.args) for node in config.nodes}


@pytest.mark.parametrize("name", ["it's", "a 'b' c", "2024_11_30", "1e3"])
def test_a_path_is_taken_as_it_is_written(tmp_path, monkeypatch, name):
    """Each alone, and relative to where roslaunch is started: an odd number of apostrophes, spaces, what eval takes for a number."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PWD", str(tmp_path))
    folder = str(tmp_path / name)
    params, _ = loaded("output_dir:=" + name, "record:=true")
    assert params["/slam/output_dir"] == folder and params["/record_outputs/bag"] == folder + "/outputs.bag"
    params, _ = loaded("record:=true", "record_path:=" + name)
    assert params["/record_outputs/bag"] == folder
    assert loaded("rviz:=true", "rviz_config:=" + name)[1]["rviz"] == ["-d", folder]
    config = name + ".yaml"
    shutil.copy(os.path.join(ROOT, "config", "default.yaml"), config)
    assert loaded("config:=" + config)[0]["/slam/config_file"].strip() == str(tmp_path / config)


def test_outputs_are_recorded_in_the_folder_of_results_or_here(tmp_path, monkeypatch):
    monkeypatch.setenv("PWD", str(tmp_path))
    assert loaded("record:=true")[0]["/record_outputs/bag"] == str(tmp_path / "outputs.bag")
    assert loaded("rviz:=true", "rviz_config:=~/a b.rviz")[1]["rviz"] == ["-d", os.environ["HOME"] + "/a b.rviz"]


def test_a_folder_in_the_place_of_the_recorded_bag_is_refused_before_the_run(tmp_path):
    with pytest.raises(OSError, match="is a folder, allowed: the file to write"):
        OutputRecorder(str(tmp_path))


@pytest.mark.parametrize("path", ["/proc/x.bag", "/proc/none/x.bag", "/dev/null/x.bag"])
def test_a_bag_that_cannot_be_made_is_refused_before_the_run(path):
    with pytest.raises(OSError, match="%s: cannot be made in /" % path):
        OutputRecorder(path)


def test_a_full_disk_ends_the_recording_and_is_told_of_once(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")
    told = []
    monkeypatch.setattr(OutputRecorder, "_subscribe", lambda *_: None)
    monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time(5))
    monkeypatch.setattr(rospy, "logfatal", lambda text, *values: told.append(text % values))
    monkeypatch.setattr(rosbag.Bag, "write", full)
    recorder = OutputRecorder(str(tmp_path / "x.bag"))
    message = rospy.AnyMsg()
    message._buff, message._connection_header = b"", {"type": "a/B", "md5sum": "*"}
    for _ in range(3):
        recorder.on_message(message, ("/pose", False))
    assert told == ["record_outputs: %s: No space left on device; nothing more is recorded" % (tmp_path / "x.bag")]
    assert recorder.failed and not recorder.close()
