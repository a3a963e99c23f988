"""Calibration as people have it: what is read of each format, what is written, what is refused."""

import json
import os
import subprocess

import numpy as np
import pytest
import rosbag
import yaml
from conftest import HANG_S, script
from folders import IMU, asl_folder, assert_same_rig, kitti_raw_folder
from roslaunch.config import load_config_default

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse
from vi_ekf_slam.recordings.calibration_importer import main, make_parser
from vi_ekf_slam.recordings.rig_calibration import read_calibration, read_noise
from vi_ekf_slam.ros.private_ros import child, ros_master

KALIBR_IMU = IMU.split("\n", 1)[1].replace("rate_hz", "update_rate")
IMU_R_CAM = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def imu_T(x, y):
    """Pose of a camera of SENSOR on the IMU."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = IMU_R_CAM, [x, y, 0.05]
    return pose


def write_camchain(folder, second="T_cn_cnm1", **changes):
    """Kalibr's file of the rig that asl_folder has."""
    camera = {"camera_model": "pinhole", "intrinsics": [50.0, 51.0, 31.0, 24.5], "distortion_model": "radtan",
              "distortion_coeffs": [-0.28, 0.07, 0.0002, 0.00002], "resolution": [64, 48]}
    left, right = imu_T(0.1, 0.05), imu_T(0.1, -0.06)
    other = inverse(right) if second == "T_cam_imu" else inverse(right) @ left
    cameras = {"cam0": dict(camera, T_cam_imu=inverse(left).tolist(), timeshift_cam_imu=-0.004),
               "cam1": dict(camera, **{second: other.tolist()})}
    cameras["cam0"].update(changes)
    path = folder / "camchain-imucam.yaml"
    path.write_text(yaml.safe_dump(cameras))
    return path


@pytest.fixture
def rig(tmp_path):
    """The calibration of asl_folder, and the folder."""
    return read_calibration([str(asl_folder(tmp_path / "euroc"))]), tmp_path


@pytest.mark.parametrize("second", ["T_cn_cnm1", "T_cam_imu"])
def test_kalibr_says_the_same_as_euroc(rig, second):
    rig, folder = rig
    (folder / "imu.yaml").write_text(KALIBR_IMU)
    kalibr = read_calibration([str(write_camchain(folder, second))], str(folder / "imu.yaml"))
    assert_same_rig(kalibr, rig)
    assert kalibr.noise == rig.noise and kalibr.time_offset == -0.004 and rig.time_offset is None
    np.testing.assert_allclose(rig.imu_T_left[:3, 3], [0.1, 0.05, 0.05])  # the left camera is to the left of the IMU
    np.testing.assert_allclose(rig.left_T_right[:3, 3], [0.11, 0.0, 0.0], atol=1e-12)


def test_openvins_says_the_same(rig):
    """Its files begin with OpenCV's `%YAML:1.0`, and most hold T_imu_cam, the inverse of Kalibr's T_cam_imu."""
    rig, folder = rig
    cameras = yaml.safe_load(write_camchain(folder, "T_cam_imu").read_text())
    for camera in cameras.values():
        camera["T_imu_cam"] = inverse(np.array(camera.pop("T_cam_imu"))).tolist()
    first = "%YAML:1.0 # need to specify the file type at the top!\n\n"
    (folder / "chain.yaml").write_text(first + yaml.safe_dump(cameras))
    (folder / "imu.yaml").write_text(first + yaml.safe_dump({"imu0": yaml.safe_load(KALIBR_IMU)}))
    found = read_calibration([str(folder / "chain.yaml")], str(folder / "imu.yaml"))
    assert_same_rig(found, rig)
    assert found.noise == rig.noise


def test_a_camchain_of_cameras_alone_takes_the_extrinsic_that_is_given(rig):
    """As kalibr_calibrate_cameras writes it, before an IMU is calibrated."""
    rig, folder = rig
    cameras = yaml.safe_load(write_camchain(folder).read_text())
    del cameras["cam0"]["T_cam_imu"]
    chain, where = folder / "camchain.yaml", folder / "where.yaml"
    chain.write_text(yaml.safe_dump(cameras))
    with pytest.raises(InputError, match="cam0: T_cam_imu is missing.*--imu-T-left"):
        read_calibration([str(chain)])
    for key in ("imu_T_left", "T_imu_cam"):
        where.write_text(yaml.safe_dump({key: np.ravel(rig.imu_T_left).tolist()}))
        assert_same_rig(read_calibration([str(chain)], None, str(where)), rig)


def test_coefficients_without_a_model_are_refused(tmp_path):
    path = write_camchain(tmp_path)
    values = yaml.safe_load(path.read_text())
    del values["cam0"]["distortion_model"]
    path.write_text(yaml.safe_dump(values))
    with pytest.raises(InputError, match="cam0: distortion_model is missing, of which distortion_coeffs are, allowed: "):
        read_calibration([str(path)])


def test_two_sensor_files_say_the_same(rig):
    rig, folder = rig
    files = [str(folder / "euroc" / "mav0" / name / "sensor.yaml") for name in ("cam0", "cam1", "imu0")]
    two = read_calibration(files[:2], files[2])
    assert_same_rig(two, rig)
    assert two.noise == rig.noise


def test_kitti_gives_the_rectified_pair(tmp_path):
    rig = read_calibration([str(kitti_raw_folder(tmp_path / "drive"))])
    assert rig.left_T_right[0, 3] == pytest.approx(0.5) and rig.right.projection[0, 3] == -25.0 and rig.noise is None
    assert (rig.left.distortion == 0).all() and (rig.left.rectification == np.eye(3)).all()


@pytest.mark.parametrize("changes, message", [
    ({"T_cam_imu": None}, "T_cam_imu"), ({"distortion_model": "omni"}, "distortion_model is 'omni', allowed: "),
    ({"camera_model": "omni"}, "allowed: pinhole (Kalibr's pinhole-radtan; "), ({"resolution": [0, 0]}, "resolution is 0 x 0 px, allowed: "), ({"intrinsics": [1.0, 2.0]}, "intrinsics has shape"),
    ({"timeshift_cam_imu": 5.0}, "timeshift_cam_imu is 5 s, allowed: -1 to 1"),
    ({"timeshift_cam_imu": "late"}, "timeshift_cam_imu is 'late', allowed: numbers"),
    ({"T_cam_imu": np.diag([1.0, 1.0, 2.0, 1.0]).tolist()}, "T_cam_imu")])
def test_what_is_wrong_is_named(tmp_path, capsys, changes, message):
    path = write_camchain(tmp_path, **changes)
    assert main([str(path), "--output", str(tmp_path / "out.launch")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and str(path) in error and message in error, error
    assert not (tmp_path / "out.launch").exists()


@pytest.mark.parametrize("arguments, message", [
    (["--output", "out.txt"], "ends in .launch"), (["--bag", "in.bag"], "--bag needs --output"),
    (["--bag", "in.bag", "--output", "out.launch"], "ends in .bag"), (["--imu", "none.yaml"], "none.yaml: no such file"),
    (["--output", "out.launch", "--imu-frame", "/imu"], "without a leading slash"),
    (["--output", "out.launch", "--imu-frame", "a", "--left-frame", "a"], "are 'a', allowed: three different ones"),
    (["--output", "out.launch", "--left-frame", "b", "--right-frame", "b"], "are 'b', allowed: three different ones")])
def test_bad_requests_are_refused(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert main([str(write_camchain(tmp_path))] + arguments) == 2
    assert message in capsys.readouterr().err and sorted(p.name for p in tmp_path.iterdir()) == ["camchain-imucam.yaml"]


def test_a_folder_that_is_none_is_refused(tmp_path):
    with pytest.raises(InputError, match="is no calibration, allowed: a folder with cam0"):
        read_calibration([str(tmp_path)])


def test_a_bag_gets_what_the_converter_would_have_written(rig):
    _, folder = rig
    done = script("dataset_to_bag.py", folder / "euroc", folder / "whole.bag", "--quiet")
    assert done.returncode == 0, done.stderr
    with rosbag.Bag(str(folder / "whole.bag")) as whole, rosbag.Bag(str(folder / "bare.bag"), "w") as bare:
        for topic, message, stamp in whole.read_messages():
            if topic != "/tf_static" and "right/camera_info" not in topic:
                bare.write(topic, message, stamp)
    done = script("import_calibration.py", folder / "euroc", "--bag", folder / "bare.bag", "--output", folder / "out.bag")
    assert done.returncode == 0 and "4 of camera_info replaced" in done.stdout, done.stdout + done.stderr
    assert "the configuration needs:\n  inertial: {imu_calibration: %s}\n" % (folder / "out.imu.yaml") in done.stdout
    with rosbag.Bag(str(folder / "whole.bag")) as whole, rosbag.Bag(str(folder / "out.bag")) as out:
        for topic in ("/left/camera_info", "/right/camera_info", "/tf_static"):
            wanted = next(whole.read_messages([topic])).message
            found = [message for _, message, _ in out.read_messages([topic])]
            assert len(found) == 1
            for message in (wanted, found[0]):
                for part in getattr(message, "transforms", [message]):
                    part.header.stamp = part.header.seq = 0
            assert found[0] == wanted
        for topic in ("/imu", "/left/image/compressed"):
            assert [str(m.message) for m in out.read_messages([topic])] == [str(m.message) for m in whole.read_messages([topic])]
    assert (folder / "out.imu.yaml").exists()
    done = script("import_calibration.py", folder / "euroc", "--bag", folder / "whole.bag", "--output", folder / "two.bag")
    assert done.returncode == 2 and "/tf_static already has imu_link -> left_camera_optical" in done.stderr


def test_a_bag_whose_imu_has_the_frame_of_a_camera_is_refused(rig):
    _, folder = rig
    assert script("dataset_to_bag.py", folder / "euroc", folder / "whole.bag", "--quiet").returncode == 0
    done = script("import_calibration.py", folder / "euroc", "--bag", folder / "whole.bag", "--output", folder / "out.bag",
                  "--left-frame", "imu_link")
    assert done.returncode == 2 and "are 'imu_link', allowed: three different ones" in done.stderr, done.stderr


@pytest.mark.parametrize("name", ["rig & co", "a<b", 'say "a"', "it's", "both ' and \""])
def test_a_launch_file_of_any_name_is_one(tmp_path, name):
    (tmp_path / "imu.yaml").write_text(KALIBR_IMU)
    output = tmp_path / (name + ".launch")
    assert main([str(write_camchain(tmp_path)), "--imu", str(tmp_path / "imu.yaml"), "--output", str(output)]) == 0
    config = load_config_default([(str(output), [])], None)
    assert config.params["/slam/inertial/imu_calibration"].value == str(tmp_path / (name + ".imu.yaml"))


LISTENER = """
import json, rospy, sys
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage
rospy.init_node("listener")
info = [rospy.wait_for_message("/cams/%s" % side, CameraInfo, 60) for side in ("l", "r")]
tf = rospy.wait_for_message("/tf_static", TFMessage, 60)
print(json.dumps({"P": [list(i.P) for i in info], "frames": [i.header.frame_id for i in info],
                  "tf": [[t.header.frame_id, t.child_frame_id, t.transform.translation.x] for t in tf.transforms],
                  "slam": rospy.get_param("/slam")}))
"""


def test_the_launch_file_publishes_it(rig):
    rig, folder = rig
    (folder / "imu.yaml").write_text(KALIBR_IMU)
    assert main([str(write_camchain(folder)), "--imu", str(folder / "imu.yaml"), "--imu-frame", "imu4", "--output",
                 str(folder / "rig.launch")]) == 0
    with ros_master(str(folder)) as environment, open(str(folder / "roslaunch.log"), "wb") as log:
        with child(["roslaunch", str(folder / "rig.launch"), "left_info:=/cams/l", "right_info:=/cams/r"],
                   env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log):
            done = subprocess.run(["/usr/bin/python3", "-c", LISTENER], env=environment, stdout=subprocess.PIPE,
                                  timeout=HANG_S, check=True)
    heard = json.loads(done.stdout.decode().splitlines()[-1])
    np.testing.assert_allclose(heard["P"], [np.ravel(rig.left.projection), np.ravel(rig.right.projection)])
    assert heard["frames"] == ["left_camera_optical", "right_camera_optical"]
    assert [t[:2] for t in heard["tf"]] == [["imu4", "left_camera_optical"], ["left_camera_optical", "right_camera_optical"]]
    assert heard["tf"][0][2] == pytest.approx(0.1)
    assert heard["slam"] == {"calibration": {"time_offset": -0.004}, "inertial": {"imu_calibration": str(folder / "rig.imu.yaml")}}


def test_converter_and_importer_take_the_same_calibration_of_a_folder(tmp_path, capsys):
    folder = asl_folder(tmp_path / "drive")
    (folder / "dso").mkdir()
    chain = write_camchain(folder / "dso", timeshift_cam_imu=0.05)
    rig = read_calibration([str(folder)])
    assert rig.time_offset == 0.05 and rig.noise == read_noise(str(folder / "mav0" / "imu0" / "sensor.yaml"))
    assert np.allclose(rig.imu_T_left, read_calibration([str(chain)]).imu_T_left)
    assert convert([str(folder), str(tmp_path / "drive.bag")]) == 0
    assert "calibration/time_offset: 0.050000000" in capsys.readouterr().out


def change_second(path, **changes):
    """The same camchain with other values of cam1; its path as text."""
    values = yaml.safe_load(path.read_text())
    values["cam1"].update(changes)
    path.write_text(yaml.safe_dump(values))
    return str(path)


@pytest.mark.parametrize("first, second, line", [
    (-0.004, 0.012, "clock: timeshift_cam_imu of cam1 differs by 16.000 ms from that of cam0, which is taken"),
    (None, 0.012, "clock: cam1 has a timeshift_cam_imu of 12.000 ms, cam0 has none: none is taken"),
    (-0.004, -0.004, None), (-0.004, None, None)])
def test_clocks_of_two_cameras_that_differ_are_told(tmp_path, capsys, first, second, line):
    path = change_second(write_camchain(tmp_path, timeshift_cam_imu=first), timeshift_cam_imu=second)
    assert main([path]) == 0
    assert [found for found in capsys.readouterr().out.splitlines() if "cam1" in found] == ([line] if line else [])


@pytest.mark.parametrize("baseline, line", [
    (0.11, None), (0.11004, None),  # the digits of a file
    (0.5, "cam1: T_cn_cnm1 is 0.00 deg and 390.0 mm from what is taken, the transforms of both cameras to the IMU")])
def test_two_places_of_a_camera_are_told(tmp_path, capsys, baseline, line):
    stated = np.eye(4)
    stated[0, 3] = -baseline
    assert main([change_second(write_camchain(tmp_path, "T_cam_imu"), T_cn_cnm1=stated.tolist())]) == 0
    assert [found for found in capsys.readouterr().out.splitlines() if "cam1" in found] == ([line] if line else [])


def test_the_converter_tells_of_contradictions_too(tmp_path, capsys):
    folder = asl_folder(tmp_path / "drive")
    change_second(write_camchain(folder), timeshift_cam_imu=0.012)
    assert convert([str(folder), "--info"]) == 0
    assert "timeshift_cam_imu of cam1 differs by 16.000 ms" in capsys.readouterr().out


def test_a_pair_that_cannot_be_rectified_is_refused(tmp_path, capsys):
    """Intrinsics of a picture one pixel wide."""
    assert main([str(write_camchain(tmp_path, intrinsics=[0.6, 457.0, 0.5, 248.0]))]) == 2
    assert "P of the rectified pair is" in capsys.readouterr().err


def test_how_wide_a_rectified_picture_is_is_told(tmp_path, capsys):
    path = write_camchain(tmp_path, distortion_model="none")
    assert main([change_second(path, distortion_model="none")]) == 0
    assert "rectified focal length 51.0 px, 64 deg wide" in capsys.readouterr().out  # 2 atan(32 / 51)


def test_cameras_in_one_place_are_refused(tmp_path):
    path = write_camchain(tmp_path)
    values = yaml.safe_load(path.read_text())
    values["cam1"]["T_cn_cnm1"] = np.eye(4).tolist()
    path.write_text(yaml.safe_dump(values))
    with pytest.raises(InputError, match="both cameras are in one place"):
        read_calibration([str(path)])


def test_the_users_own_noise_file_is_not_replaced(tmp_path, capsys):
    noise = tmp_path / "rig.imu.yaml"
    noise.write_text("# mine\n" + IMU)
    assert main([str(write_camchain(tmp_path)), "--imu", str(noise), "--output", str(tmp_path / "rig.launch")]) == 2
    assert "is the input itself" in capsys.readouterr().err
    assert noise.read_text() == "# mine\n" + IMU and not (tmp_path / "rig.launch").exists()


def test_topics_without_a_leading_slash_are_those_with_one():
    options = make_parser().parse_args(["file", "--left-info", "a/camera_info", "--right-info", "/b/camera_info", "--imu-topic", "imu"])
    assert (options.left_info, options.right_info, options.imu_topic) == ("/a/camera_info", "/b/camera_info", "/imu")


@pytest.mark.parametrize("name", ["rig", "realsense_d435i", "zed2"])
def test_launch_files_of_rigs_start_both_nodes(name, tmp_path):
    calibration = tmp_path / "rig.launch"
    assert main([str(write_camchain(tmp_path)), "--output", str(calibration)]) == 0
    extra = ["calibration:=" + calibration.name, "ns:=robot"] if name == "rig" else []  # relative
    done = subprocess.run(["roslaunch", "--nodes", "vi_ekf_slam", name + ".launch"] + extra, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, universal_newlines=True, timeout=HANG_S, cwd=str(tmp_path),
                          env=dict(os.environ, PWD=str(tmp_path)))
    nodes = [line for line in done.stdout.splitlines() if line.startswith("/")]
    assert done.returncode == 0 and nodes == (
        ["/robot/front_end", "/robot/slam", "/robot/publish_calibration"] if extra else ["/front_end", "/slam"]), done.stdout
