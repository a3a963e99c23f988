"""What is in a converted bag, and that it appears whole or not at all."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import rosbag
from conftest import CAM_R_IMU, CAMERA_IN_IMU, HANG_S, drive, script_path, second_edition

from vi_ekf_slam.bag.converter import main
from vi_ekf_slam.common.checks import nanoseconds
from vi_ekf_slam.common.geometry import make_transform, quaternion_to_rotation
from vi_ekf_slam.dataset.as_recording import image_size

PER_FRAME = ["/left/camera_info", "/right/camera_info", "/imu", "/velocity", "/features"]


@pytest.fixture
def convert(save, tmp_path):
    """Converts a drive in this process; returns the bag's path."""
    def run(arrays, *options, name="out.bag"):
        path = str(tmp_path / name)
        assert main([save(arrays), path, "--quiet"] + list(options)) == 0
        return path
    return run


def contents(path):
    with rosbag.Bag(path) as bag:
        return list(bag.read_messages(return_connection_header=True))


def by_topic(path, topic):
    return [m.message for m in contents(path) if m.topic == topic]


def in_file_order(path):
    """(topic, record time) as the bytes lie in the file."""
    with rosbag.Bag(path) as bag:
        entries = sorted((e.chunk_pos, e.offset) for entries in bag._connection_indexes.values() for e in entries)
        return [(m[0], m[2].to_nsec()) for m in (bag._read_message(p) for p in entries)]


def test_topics_types_and_counts(convert):
    with rosbag.Bag(convert(drive())) as bag:
        topics = {t: (i.msg_type, i.message_count) for t, i in bag.get_type_and_topic_info().topics.items()}
    assert topics == {
        "/tf_static": ("tf2_msgs/TFMessage", 1),
        "/twist_bias": ("geometry_msgs/TwistWithCovarianceStamped", 1), "/imu": ("sensor_msgs/Imu", 8),
        "/velocity": ("geometry_msgs/TwistWithCovarianceStamped", 8),
        "/features": ("vi_ekf_slam/StereoFeatureArray", 8),
        "/left/camera_info": ("sensor_msgs/CameraInfo", 8), "/right/camera_info": ("sensor_msgs/CameraInfo", 8)}


def test_order_and_record_times(convert):
    arrays = drive()
    stamps = nanoseconds(arrays["time_stamps"][0]).tolist()
    expected = [("/tf_static", stamps[0]), ("/twist_bias", stamps[0])] + [(topic, t) for t in stamps for topic in PER_FRAME]
    path = convert(arrays)
    assert in_file_order(path) == expected
    for m in contents(path):
        if m.topic in PER_FRAME:
            assert m.message.header.stamp == m.timestamp


def test_stamps_keep_what_a_double_holds():
    assert nanoseconds(np.float64(1317386425.5625024)) == 1317386425562502384
    assert nanoseconds(np.float64(1.9999999999)) == 2000000000


def test_only_the_static_topics_are_latched(convert, tmp_path):
    truth = tmp_path / "truth.txt"
    truth.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    latched = {m.topic for m in contents(convert(drive(), "--truth", str(truth)))
               if m.connection_header.get("latching") in ("1", b"1")}
    assert latched == {"/tf_static", "/twist_bias", "/ground_truth/path"}


def test_imu(convert):
    arrays = drive()
    messages = by_topic(convert(arrays, "--gyro-sigma", "0.2"), "/imu")
    for k, m in enumerate(messages):
        w = m.angular_velocity
        assert [w.x, w.y, w.z] == list(arrays["rotational_velocity"][:, k])
        assert np.allclose(np.reshape(m.angular_velocity_covariance, (3, 3)), 0.04 * np.eye(3))
        assert m.orientation_covariance[0] == -1.0 and m.linear_acceleration_covariance[0] == -1.0
        assert m.header.frame_id == "imu_link"


def test_velocity(convert):
    arrays = drive()
    messages = by_topic(convert(arrays, "--velocity-sigma", "0.3"), "/velocity")
    for k, m in enumerate(messages):
        v, w = m.twist.twist.linear, m.twist.twist.angular
        assert [v.x, v.y, v.z] == list(arrays["linear_velocity"][:, k]) and [w.x, w.y, w.z] == [0.0, 0.0, 0.0]
        assert np.allclose(np.reshape(m.twist.covariance, (6, 6)), np.diag([0.09] * 3 + [1e6] * 3))
        assert m.header.frame_id == "imu_link"


def test_default_noise(convert):
    path = convert(drive())
    assert by_topic(path, "/imu")[0].angular_velocity_covariance[4] == pytest.approx(0.05**2)
    assert by_topic(path, "/velocity")[0].twist.covariance[7] == pytest.approx(0.5**2)


def test_features(convert):
    arrays = drive()
    messages = by_topic(convert(arrays), "/features")
    for k, m in enumerate(messages):
        pixels = arrays["features"][:, :, k]
        expected = [[i] + list(pixels[:, i]) for i in range(12) if pixels[0, i] != -1]
        assert [[f.id, f.u_left, f.v_left, f.u_right, f.v_right] for f in m.features] == expected
        assert m.header.frame_id == "left_camera_optical"


def test_a_frame_that_sees_nothing_is_an_empty_list(convert):
    features = drive()["features"]
    features[:, :, 4] = -1.0
    assert [len(m.features) for m in by_topic(convert(drive(features=features)), "/features")][3:6] == [11, 0, 11]


def test_stale_tracks_get_new_ids_unless_told_otherwise(convert):
    features = drive()["features"]
    features[:, :, 6] = features[:, :, 5]
    for options, expected in ((), list(range(12, 23))), (("--keep-stale",), list(range(1, 12))):
        messages = by_topic(convert(drive(features=features), *options), "/features")
        assert [f.id for f in messages[5].features] == list(range(1, 12))
        assert [f.id for f in messages[6].features] == expected == [f.id for f in messages[7].features]


def test_camera_infos(convert):
    path = convert(drive())
    left, right = by_topic(path, "/left/camera_info")[3], by_topic(path, "/right/camera_info")[3]
    k = [700.0, 0, 320.0, 0, 650.0, 240.0, 0, 0, 1]
    for info in (left, right):
        assert list(info.K) == k and list(info.D) == [0.0] * 5 and info.distortion_model == "plumb_bob"
        assert np.array_equal(np.reshape(info.R, (3, 3)), np.eye(3))
        assert (info.width, info.height) == (640, 480)
    assert list(left.P) == [700.0, 0, 320.0, 0, 0, 650.0, 240.0, 0, 0, 0, 1, 0]
    assert list(right.P) == [700.0, 0, 320.0, -350.0, 0, 650.0, 240.0, 0, 0, 0, 1, 0]
    assert left.header.frame_id == "left_camera_optical" and right.header.frame_id == "right_camera_optical"


@pytest.mark.parametrize("focal_length, pixel, size", [
    (721.5377, 100.0, (1242, 375)), (707.0912, 100.0, (1226, 370)), (700.0, 100.0, (640, 480)),
    (700.0, 800.0, (801, 801)), (721.5377, 1241.9, (1242, 1242))])
def test_image_size_is_known_or_guessed_and_covers_every_pixel(focal_length, pixel, size):
    intrinsics = np.array([[focal_length, 0, 320], [0, focal_length, 240], [0, 0, 1]])
    assert image_size(intrinsics, np.full((1, 4), pixel)) == size
    assert image_size(intrinsics, np.zeros((0, 4)))[0] >= 640


@pytest.mark.parametrize("arrays, options, position", [
    (drive(), (), CAMERA_IN_IMU), (drive(), ("--extrinsic", "given"), -CAM_R_IMU.T @ CAMERA_IN_IMU),
    (second_edition(), (), CAMERA_IN_IMU)], ids=["repaired", "given", "second edition"])
def test_static_transforms_carry_the_cameras_pose_on_the_imu(convert, arrays, options, position):
    to_left, to_right = by_topic(convert(arrays, *options), "/tf_static")[0].transforms
    assert (to_left.header.frame_id, to_left.child_frame_id) == ("imu_link", "left_camera_optical")
    t, q = to_left.transform.translation, to_left.transform.rotation
    assert np.allclose([t.x, t.y, t.z], position)
    assert np.allclose(quaternion_to_rotation([q.x, q.y, q.z, q.w]), CAM_R_IMU.T)
    assert (to_right.header.frame_id, to_right.child_frame_id) == ("left_camera_optical", "right_camera_optical")
    t, q = to_right.transform.translation, to_right.transform.rotation
    assert [t.x, t.y, t.z, q.x, q.y, q.z, q.w] == [0.5, 0, 0, 0, 0, 0, 1]


@pytest.mark.parametrize("options, velocity, gyro", [
    ((), 0.001, 0.01), (("--gyro-sigma", "0.01"), 0.001, 0.0003),
    (("--gyro-sigma", "0.01", "--gyro-bias-sigma", "0.02", "--velocity-bias-sigma", "0.1"), 0.1, 0.02)],
    ids=["noise was added", "as the INS recorded it", "as stated"])
def test_what_is_known_of_the_biases(convert, options, velocity, gyro):
    (bias,) = by_topic(convert(drive(), *options), "/twist_bias")
    assert bias.header.frame_id == "imu_link" and bias.twist.twist.linear.x == bias.twist.twist.angular.z == 0.0
    assert np.allclose(np.reshape(bias.twist.covariance, (6, 6)), np.diag([velocity**2] * 3 + [gyro**2] * 3))


def test_without_features_imu_and_velocity_remain(convert):
    topics = {m.topic for m in contents(convert(drive(features=None, K=None, b=None), "--without-features"))}
    assert topics == {"/imu", "/velocity", "/tf_static", "/twist_bias"}


def test_truth_of_the_camera_becomes_poses_of_the_imu(convert, tmp_path):
    # The IMU turns left by 90 deg on the spot and then goes 2 m along its new x axis.
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    imu_poses = [np.eye(4), make_transform(turn, [0, 0, 0]), make_transform(turn, [0, 2.0, 0])]
    imu_T_cam = make_transform(CAM_R_IMU.T, CAMERA_IN_IMU)
    rows = [(np.linalg.inv(imu_T_cam) @ p @ imu_T_cam)[:3].ravel() for p in imu_poses]
    truth = tmp_path / "truth.txt"
    np.savetxt(str(truth), rows)
    path = convert(drive(), "--truth", str(truth))
    poses = by_topic(path, "/ground_truth/pose")
    assert len(poses) == 3  # fewer rows than frames: the first frames
    for m, expected, stamp in zip(poses, imu_poses, drive()["time_stamps"][0]):
        p, q = m.pose.position, m.pose.orientation
        assert np.allclose([p.x, p.y, p.z], expected[:3, 3])
        assert np.allclose(quaternion_to_rotation([q.x, q.y, q.z, q.w]), expected[:3, :3])
        assert m.header.frame_id == "map" and m.header.stamp.to_nsec() == nanoseconds(stamp)
    trajectory = by_topic(path, "/ground_truth/path")
    assert len(trajectory) == 1 and [str(p.pose) for p in trajectory[0].poses] == [str(p.pose) for p in poses]
    assert trajectory[0].header.frame_id == "map"
    frames = [t.child_frame_id for m in by_topic(path, "/tf_static") for t in m.transforms]
    assert frames == ["left_camera_optical", "right_camera_optical"]  # nothing of the truth on TF


def test_truth_poses_are_recorded_at_their_stamps(convert, tmp_path):
    start = drive()["time_stamps"][0, 0]
    truth = tmp_path / "truth.tum"
    truth.write_text("".join("%.9f %d 0 0 0 0 0 1\n" % (start + t, k) for k, t in enumerate((0.0, 0.05, 0.1, 0.7))))
    order = [topic for topic, _ in in_file_order(convert(drive(), "--truth", str(truth)))]
    pose = ["/ground_truth/pose"]
    # At equal stamps after the frame's own messages, between frames in between; the last frame's is not lost.
    assert order[:16] == ["/tf_static", "/twist_bias", "/ground_truth/path"] + PER_FRAME + 2 * pose + PER_FRAME + pose
    assert order[-6:] == PER_FRAME + pose and order.count(pose[0]) == 4


def test_conversion_is_deterministic(convert):
    first, second = (open(convert(drive(), name=name), "rb").read() for name in ("a.bag", "b.bag"))
    assert first == second


def test_an_old_bag_is_replaced_on_success_and_kept_on_failure(save, tmp_path):
    target = tmp_path / "out.bag"
    target.write_bytes(b"old")
    assert main([save(drive(K=None)), str(target)]) == 2
    assert target.read_bytes() == b"old"
    assert main([save(drive()), str(target), "--quiet"]) == 0
    assert len(contents(str(target))) == 42
    assert sorted(os.listdir(str(tmp_path))) == ["drive.npz", "out.bag"]


def test_a_failure_while_writing_leaves_nothing(save, tmp_path, monkeypatch):
    def fail(self):
        raise OSError(28, "No space left on device")
    monkeypatch.setattr(rosbag.Bag, "close", fail)
    assert main([save(drive()), str(tmp_path / "out.bag"), "--quiet"]) == 2
    assert os.listdir(str(tmp_path)) == ["drive.npz"]


@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_conversion_leaves_nothing(save, tmp_path, signum):
    frames = 30000  # seconds of work
    source = save(drive(frames=frames, landmarks=12))
    target = tmp_path / "out.bag"
    target.write_bytes(b"old")
    process = subprocess.Popen([sys.executable, script_path("dataset_to_bag.py"), source, str(target)],
                               stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, universal_newlines=True)
    while process.poll() is None and not any(n.endswith(".part") for n in os.listdir(str(tmp_path))):
        time.sleep(0.005)
    assert process.poll() is None, "ended before writing began"
    process.send_signal(signum)
    _, errors = process.communicate(timeout=HANG_S)
    assert process.returncode == 128 + signum and "Traceback" not in errors
    assert sorted(os.listdir(str(tmp_path))) == ["drive.npz", "out.bag"]
    assert target.read_bytes() == b"old"
