"""rviz without a screen: what is recorded, exported and drawn. Starts the real rviz under Xvfb."""

import importlib.util
import os
import shutil
import subprocess
import time

import numpy as np
import pytest
import rosbag
import rospy
import yaml
from conftest import HANG_S, ROOT, process, script
from rviz_scene import Scene, has_colour, is_between_green_and_red, near, read_picture, share_hit
from sensor_msgs.msg import Image

from vi_ekf_slam.ros.private_ros import child, ros_master
from vi_ekf_slam.rviz import offers, renderer
from vi_ekf_slam.rviz.session import RvizCrash, RvizSession

SIZE = (900, 600)
OUTPUT_TOPICS = {"/path", "/dead_reckoning/path", "/ground_truth/path", "/landmarks", "/landmark_cloud", "/odometry",
                 "/dead_reckoning/odometry", "/pose", "/tf", "/tf_static", "/diagnostics"}
FRAME_NAMES = {"map": "world", "odom": "robot1/odom", "imu_link": "robot1/body"}
EXPORT_OPTIONS = ["--map-frame", "world", "--odom-frame", "robot1/odom", "--imu-frame", "robot1/body",
                  "--namespace", "/robot1", "--truth", "/robot1/ground_truth/path"]


def has_rviz():
    return getattr(importlib.util.find_spec("rviz"), "origin", None) is not None and shutil.which("Xvfb") is not None


needs_rviz = pytest.mark.skipif(not has_rviz(), reason="NOT RUN: rviz's Python module or Xvfb is not installed "
                                                       "(Debian: python3-rviz xvfb)")


def succeed(name, *arguments):
    done = script(name, *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A simulated drive as drive.bag, and what slam.launch record:=true makes of it as outputs.bag."""
    path = tmp_path_factory.mktemp("rviz")
    succeed("simulate_dataset.py", path / "drive.npz", "--duration", "14", "--quiet")
    succeed("dataset_to_bag.py", path / "drive.npz", path / "drive.bag", "--quiet",
            "--truth", path / "drive_truth_left_camera.txt")
    with ros_master(str(path)) as environment:
        done = subprocess.run(["roslaunch", "vi_ekf_slam", "slam.launch", "bag:=%s" % (path / "drive.bag"), "rate:=4",
                               "record:=true", "output_dir:=%s" % path], env=environment, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, timeout=HANG_S)
    assert done.returncode == 0 and (path / "outputs.bag").is_file(), done.stdout.decode()
    return path


def shipped(name="vi_ekf_slam.rviz"):
    with open(os.path.join(ROOT, "rviz", name), encoding="utf-8") as stream:
        return yaml.safe_load(stream)


def test_the_recording_is_whole_and_closed(folder):
    assert not (folder / "outputs.bag.active").exists()
    with rosbag.Bag(str(folder / "outputs.bag")) as bag:
        assert OUTPUT_TOPICS <= set(bag.get_type_and_topic_info().topics)
        messages = {topic: [m for _, m, _ in bag.read_messages([topic])] for topic in ("/odometry", "/dead_reckoning/odometry", "/path")}
        duration = bag.get_end_time() - bag.get_start_time()
        latching = {c.topic for c in bag._get_connections() if c.header.get("latching") in ("1", b"1")}
    stamps = np.loadtxt(str(folder / "trajectory.tum"))[:, 0]
    assert 13.0 < duration < 20.0  # what comes before the simulated clock has no time of its own
    for topic in ("/odometry", "/dead_reckoning/odometry"):
        recorded = [m.header.stamp.to_sec() for m in messages[topic]]
        assert np.allclose(recorded, stamps, rtol=0.0, atol=1e-6)  # every frame, none twice
    assert len(messages["/path"]) < 20  # thinned to one a second ...
    end = messages["/path"][-1].poses[-1].pose.position
    last = np.loadtxt(str(folder / "trajectory.tum"))[-1, 1:4]
    assert np.allclose([end.x, end.y, end.z], last, atol=0.2)  # ... to the end
    assert {"/tf_static", "/path", "/landmarks", "/ground_truth/path"} <= latching


def rename(source, target):
    """The outputs as another robot would publish them: topics below /robot1, frames of other names."""
    with rosbag.Bag(str(source)) as old, rosbag.Bag(str(target), "w") as new:
        for topic, message, stamp in old.read_messages():
            for part in [message] + list(getattr(message, "transforms", [])) + list(getattr(message, "markers", [])):
                if hasattr(part, "header"):
                    part.header.frame_id = FRAME_NAMES.get(part.header.frame_id, part.header.frame_id)
                if hasattr(part, "child_frame_id"):
                    part.child_frame_id = FRAME_NAMES.get(part.child_frame_id, part.child_frame_id)
            new.write(topic if topic.startswith("/tf") else "/robot1" + topic, message, stamp)


def check_picture(path, config, scene):
    """Path and landmarks have their colours where rviz's camera must show them, and the path's is nowhere else."""
    displays = {d["Name"]: d for d in config["Visualization Manager"]["Displays"]}
    view = config["Visualization Manager"]["Views"]["Current"]
    picture = read_picture(path)
    assert picture.shape[0] > SIZE[1] and picture.shape[1:] == (SIZE[0], 3)
    legend, picture = picture[SIZE[1]:], picture[:SIZE[1]]
    for shown in [[int(c) for c in displays[name]["Color"].split(";")] for name in ("Path", "Dead reckoning")] + [
            [0, 255, 0], [255, 0, 0]]:  # the ends of the landmarks' colours
        assert has_colour(legend, shown).sum() > 20

    blue = has_colour(picture, [int(c) for c in displays["Path"]["Color"].split(";")])
    away = scene.path[np.linalg.norm(scene.path - scene.car, axis=1) > 8.0]  # axes and arrow hide it at the car
    pixels, _ = scene.project(away, view, SIZE)
    assert len(pixels) > 20
    assert share_hit(blue, pixels) > 0.95
    assert share_hit(blue, pixels + [25.0, 0.0]) < 0.2  # the test can fail
    pixels, _ = scene.project(scene.path, view, SIZE)
    on_path = np.zeros_like(blue)
    on_path[tuple(np.rint(pixels).astype(int).T[::-1])] = True
    assert (blue & ~near(on_path, 12)).sum() < 0.01 * blue.sum()

    landmarks, _ = scene.project(scene.landmarks, view, SIZE)
    coloured = is_between_green_and_red(picture)
    assert len(landmarks) > 100
    assert share_hit(coloured, landmarks) > 0.9
    assert share_hit(coloured, landmarks * [-1.0, 1.0] + [SIZE[0] - 1.0, 0.0]) < 0.5  # mirrored


@needs_rviz
def test_the_shipped_configuration_shows_a_drive(folder):
    """The drive goes through slam.launch while rviz looks on."""
    printed = succeed("render_rviz.py", folder / "drive.bag", folder / "shipped.png", "--size", *SIZE)
    assert [line.split(":")[0] for line in printed.splitlines()[1:]] == \
        [d["Name"] for d in shipped()["Visualization Manager"]["Displays"] if d["Enabled"]] + ["wrote"]
    check_picture(folder / "shipped.png", shipped(), Scene(str(folder / "outputs.bag")))


@needs_rviz
def test_an_exported_configuration_shows_the_recorded_outputs_of_another_robot(folder):
    rename(folder / "outputs.bag", folder / "robot1.bag")
    succeed("export_rviz_config.py", "--output", folder / "robot1.rviz", "--bag", folder / "robot1.bag",
            *EXPORT_OPTIONS)
    succeed("render_rviz.py", folder / "robot1.bag", folder / "exported.png", "--config", folder / "robot1.rviz",
            "--size", *SIZE, "--rate", 8, "--animation", folder / "exported.gif")
    config = yaml.safe_load((folder / "robot1.rviz").read_text())
    scene = Scene(str(folder / "robot1.bag"), "/robot1/path", "/robot1/landmarks", "/robot1/odometry")
    check_picture(folder / "exported.png", config, scene)
    from PIL import Image
    with Image.open(str(folder / "exported.gif")) as animation:
        assert animation.n_frames > 5


@needs_rviz
def test_a_broken_configuration_is_a_failure(folder):
    """A topic of another type, a frame that nobody knows, and a display that does not exist: each is named."""
    config = shipped()
    displays = {d["Name"]: d for d in config["Visualization Manager"]["Displays"]}
    displays["Path"]["Topic"] = "/odometry"
    displays["Landmarks from afar"]["Topic"] = "/no_such_topic"
    displays["Grid (10 m)"]["Reference Frame"] = "nowhere"
    displays["Landmarks"]["Class"] = "rviz/NoSuchDisplay"
    (folder / "broken.rviz").write_text(yaml.safe_dump(config))
    done = script("render_rviz.py", folder / "outputs.bag", folder / "broken.png", "--config", folder / "broken.rviz",
               "--rate", 20, "--size", 300, 200)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "display 'Path': its topic /odometry is published as nav_msgs/Odometry" in done.stderr
    assert "display 'Landmarks from afar': its topic /no_such_topic is not published" in done.stderr
    assert "display 'Grid (10 m)' (rviz/Grid) has the status Error" in done.stderr and "nowhere" in done.stderr
    assert "NoSuchDisplay" in done.stderr
    assert "'Dead reckoning'" not in done.stderr and "'Frames'" not in done.stderr
    assert not (folder / "broken.png").exists()


@needs_rviz
def test_an_rviz_that_a_signal_ended_is_told_from_one_that_refuses(tmp_path):
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}  # without which Qt aborts
    with pytest.raises(RvizCrash, match="ended by signal 6"):
        with RvizSession(os.path.join(ROOT, "rviz", "vi_ekf_slam.rviz"), SIZE, environment, str(tmp_path)):
            pass


@pytest.mark.parametrize("crashes, tries", [(0, 1), (1, 2), (2, 2)])
def test_a_picture_is_tried_once_more_after_a_crash(monkeypatch, capsys, crashes, tries):
    calls = []

    def draw(options):
        calls.append(options)
        if len(calls) <= crashes:
            raise RvizCrash("rviz was ended by signal 11: nothing")
    monkeypatch.setattr(renderer, "check_options", lambda options: None)
    monkeypatch.setattr(renderer, "_render", draw)
    try:
        renderer.render("options")
    except RvizCrash:
        assert crashes == 2
    assert calls == tries * ["options"] and ("once more" in capsys.readouterr().err) == (crashes > 0)


@needs_rviz
def test_the_front_ends_picture_lies_in_the_corner_where_the_bag_has_it(folder, tmp_path):
    orange, height = (255, 120, 0), 30
    with rosbag.Bag(str(folder / "outputs.bag")) as old, rosbag.Bag(str(tmp_path / "with.bag"), "w") as new:
        for topic, message, stamp in old.read_messages():
            new.write(topic, message, stamp)
        image = Image(height=height, width=40, encoding="rgb8", step=3 * 40, data=bytes(orange) * (height * 40))
        image.header.frame_id = "left_camera_optical"
        for stamp in (old.get_start_time() + 1.0, old.get_end_time()):
            image.header.stamp = rospy.Time.from_sec(stamp)
            new.write("/front_end/image", image, image.header.stamp)
    said = succeed("render_rviz.py", tmp_path / "with.bag", tmp_path / "with.png", "--size", *SIZE, "--no-legend", "--rate", 8)
    assert "Tracks: Image: " in said
    shown = has_colour(read_picture(tmp_path / "with.png"), orange)
    width = SIZE[0] // 4
    corner = shown[SIZE[1] - width * height // 40:, :width]
    assert corner.mean() > 0.9 and shown.sum() - corner.sum() < 0.01 * corner.sum()


def test_the_default_export_is_the_shipped_configuration(tmp_path):
    succeed("export_rviz_config.py", "--output", tmp_path / "same.rviz")
    assert yaml.safe_load((tmp_path / "same.rviz").read_text()) == shipped()


def test_the_configuration_for_a_room_is_the_shipped_one_at_its_scale(tmp_path):
    succeed("export_rviz_config.py", "--output", tmp_path / "small.rviz", "--scale", 0.05)
    small = yaml.safe_load((tmp_path / "small.rviz").read_text())
    assert small == shipped("handheld.rviz")
    assert small["Visualization Manager"]["Views"]["Current"]["Distance"] == pytest.approx(
        0.05 * shipped()["Visualization Manager"]["Views"]["Current"]["Distance"])
    assert [d["Name"] for d in small["Visualization Manager"]["Displays"]][0] == "Grid (1 m)"


def test_an_export_holds_none_of_the_shipped_names(tmp_path):
    succeed("export_rviz_config.py", "--output", tmp_path / "other.rviz", "--truth", "", *EXPORT_OPTIONS[:-2])
    text = (tmp_path / "other.rviz").read_text()
    values = {line.split(": ", 1)[-1].strip() for line in text.splitlines()}
    topics = {value for value in values if value.startswith("/")}
    assert topics == {"/robot1" + topic for topic in ("/path", "/dead_reckoning/path", "/pose", "/landmarks",
                                                      "/landmark_cloud", "/front_end/image")}
    assert not values & {"map", "odom", "imu_link", "map:", "odom:", "imu_link:"}
    assert "Ground truth" not in text


def test_the_bag_that_is_checked_is_not_written_over(tmp_path):
    bag = tmp_path / "drive.bag"
    bag.write_bytes(b"#ROSBAG V2.0\n")
    done = script("export_rviz_config.py", "--output", bag, "--bag", bag)
    assert done.returncode == 2 and "is the input itself" in done.stderr and bag.read_bytes() == b"#ROSBAG V2.0\n"


@pytest.mark.parametrize("arguments, named", [
    (["--path", "/track"], ["/track", "/dead_reckoning/path"]),
    (["--path", "/odometry"], ["/odometry", "nav_msgs/Odometry", "nav_msgs/Path"]),
    (["--truth", "/truth"], ["/truth", "/ground_truth/path"]),
    (["--imu-frame", "body"], ["--imu-frame", "body", "imu_link, left_camera_optical, map, odom"]),
    (["--path", "a b"], ["--path", "a b", "allowed"]),
    (["--pose", "pose/"], ["--pose", "pose/", "allowed"]),
    (["--map-frame", "/map"], ["--map-frame", "/map", "slash"]),
    (["--map-frame", "odom"], ["odom", "different"]),
    (["--namespace", "robot1"], ["--namespace", "robot1", "absolute"])])
def test_what_a_bag_does_not_have_is_named(folder, tmp_path, arguments, named):
    done = script("export_rviz_config.py", "--output", tmp_path / "x.rviz", "--bag", folder / "outputs.bag", *arguments)
    assert done.returncode == 2 and done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    assert [name for name in named if name not in done.stderr] == []
    assert not (tmp_path / "x.rviz").exists()


def test_a_topic_in_a_frame_without_connection_is_named(folder, tmp_path):
    """A converter's truth is in the frame map; a node that calls its map otherwise cannot show it."""
    rename(folder / "outputs.bag", tmp_path / "robot1.bag")
    with rosbag.Bag(str(tmp_path / "robot1.bag"), "a") as bag, rosbag.Bag(str(folder / "drive.bag")) as drive:
        for topic, message, stamp in drive.read_messages(["/ground_truth/path"]):
            bag.write(topic, message, stamp)
    done = script("export_rviz_config.py", "--output", tmp_path / "x.rviz", "--bag", tmp_path / "robot1.bag",
               *EXPORT_OPTIONS[:-2])
    assert done.returncode == 2
    assert "/ground_truth/path" in done.stderr and "'map'" in done.stderr and "'world'" in done.stderr


def test_a_drive_is_checked_for_what_it_can_tell(folder, tmp_path):
    printed = succeed("export_rviz_config.py", "--output", tmp_path / "x.rviz", "--bag", folder / "drive.bag")
    assert "only the IMU's frame and the truth" in printed
    done = script("export_rviz_config.py", "--output", tmp_path / "x.rviz", "--bag", folder / "drive.bag",
               "--imu-frame", "b")
    assert done.returncode == 2 and "imu_link" in done.stderr


@pytest.mark.parametrize("topics, expected", [
    (["/left/image/compressed"], ["front_end:=true", "image_transport:=compressed"]),
    (["/left/image"], ["front_end:=true", "image_transport:=raw"]), (["/left/image", "/features"], [])])
def test_a_drive_of_pictures_goes_through_the_front_end(tmp_path, topics, expected):
    path = str(tmp_path / "drive.bag")
    with rosbag.Bag(path, "w") as bag:
        for topic in topics:
            bag.write(topic, Image(), rospy.Time(1))
    offer = offers.read_bag(path, [])
    options = renderer.make_parser().parse_args([path, "out.png", "--rate", "2"])
    command = renderer.player_command(options, offer, [], str(tmp_path))
    assert offer.is_drive([]) and [word for word in command if word.startswith(("front_end", "image_transport"))] == expected


def test_a_running_graph_is_checked(folder, tmp_path):
    with ros_master(str(tmp_path)) as environment:
        arguments = ["--output", tmp_path / "x.rviz", "--check-graph"]
        done = process("export_rviz_config.py", *arguments, environment=environment)
        assert done.returncode == 2 and "no topic /pose" in done.stderr
        player = ["rosbag", "play", "--clock", "--rate=0.2", "--quiet", str(folder / "outputs.bag")]
        with child(player, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL):
            end = time.monotonic() + 30.0
            while done.returncode != 0 and time.monotonic() < end:
                done = process("export_rviz_config.py", *arguments, environment=environment)
            assert done.returncode == 0, done.stderr
            done = process("export_rviz_config.py", *arguments, "--odom-frame", "odometry_frame", environment=environment)
            assert done.returncode == 2 and "odometry_frame" in done.stderr and "imu_link" in done.stderr
            done = process("export_rviz_config.py", *arguments, "--landmarks", "/pose", environment=environment)
            assert done.returncode == 2 and "visualization_msgs/MarkerArray" in done.stderr


@pytest.mark.parametrize("arguments, named", [
    (["missing.bag", "out.png"], "missing.bag"), (["BAG", "out.jpg"], ".png"), (["BAG", "none/out.png"], "none"),
    (["BAG", "out.png", "--rate", "0"], "--rate"), (["BAG", "out.png", "--size", "10", "600"], "WIDTH"),
    (["BAG", "out.png", "--config", "missing.rviz"], "missing.rviz"),
    (["BAG", "out.png", "--animation", "a.png"], ".gif")])
def test_render_refuses_what_it_cannot_do(folder, tmp_path, arguments, named):
    arguments = [str(folder / "outputs.bag") if a == "BAG" else a if a.startswith("-") or a.isdigit() else
                 str(tmp_path / a) for a in arguments]
    done = script("render_rviz.py", *arguments)
    assert done.returncode == 2 and named in done.stderr and done.stderr.count("\n") == 1, done.stderr
