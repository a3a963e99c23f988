"""Drives that are folders: EuRoC and TUM-VI, KITTI raw, KITTI odometry; what is in their bags, and what is refused."""

import os
import shutil

import cv2
import numpy as np
import pytest
from conftest import data_file
from folders import ASL_STAMPS, IMU, MAKERS, PROJECTIONS, START, asl_folder, convert, options, picture

from vi_ekf_slam.bag.converter import main
from vi_ekf_slam.bag.reader import read_reference
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse, make_transform, rotation_to_quaternion, so3_exp
from vi_ekf_slam.evaluation.gauge import errors_after_yaw_alignment
from vi_ekf_slam.recordings.asl import load_asl
from vi_ekf_slam.recordings.image_files import Faults, image_size
from vi_ekf_slam.recordings.kitti import load_kitti_raw, oxts_poses, oxts_rotation, oxts_velocities
from vi_ekf_slam.recordings.kitti_files import read_oxts
from vi_ekf_slam.recordings.rectification import RawCamera, rectify

@pytest.fixture
def drive(tmp_path):
    """Makes a folder of a format below tmp_path."""
    def make(kind, **arguments):
        root = tmp_path / "drive"
        root.mkdir()
        return MAKERS[kind](root, **arguments)
    return make


@pytest.mark.parametrize("suffix, encoding", [(".png", "png"), (".jpg", "jpeg")])
def test_pictures_are_in_the_bag_byte_by_byte_at_their_stamps(drive, tmp_path, suffix, encoding):
    folder = drive("asl", suffix=suffix)
    topics = convert(folder, tmp_path)
    for camera, side in (("cam0", "left"), ("cam1", "right")):
        entries = topics["/%s/image/compressed" % side]
        assert [stamp for stamp, _ in entries] == list(ASL_STAMPS)
        for stamp, message in entries:
            assert message.header.stamp.to_nsec() == stamp and message.format == encoding
            assert message.header.frame_id == "%s_camera_optical" % side
            assert message.data == (folder / "mav0" / camera / "data" / ("%d%s" % (stamp, suffix))).read_bytes()
        assert [stamp for stamp, _ in topics["/%s/camera_info" % side]] == list(ASL_STAMPS)
    assert len(topics["/imu"]) == 41 and topics["/imu"][3][0] == START + 15000000
    w, a = topics["/imu"][3][1].angular_velocity, topics["/imu"][3][1].linear_acceleration
    assert [w.x, w.y, w.z, a.x, a.y, a.z] == [0.1, 0.2, 0.03, 0.5, -0.25, 9.8]
    assert topics["/imu"][3][1].angular_velocity_covariance[0] == pytest.approx(1e-8 * 200)
    assert "gyroscope_random_walk: 2.0e-05" in (tmp_path / "out.imu.yaml").read_text()


@pytest.mark.parametrize("model, name", [("radial-tangential", "plumb_bob"), ("equidistant", "equidistant")])
def test_camera_info_rectifies(drive, tmp_path, model, name):
    """A point in space through each raw camera, undistorted by what camera_info says: in one row, at fx b / z of disparity."""
    topics = convert(drive("asl", model=model), tmp_path)
    infos = [topics["/%s/camera_info" % side][0][1] for side in ("left", "right")]
    points = np.array([[0.3, -0.2, 4.0], [-0.5, 0.3, 3.0], [0.1, 0.1, 8.0]])  # left camera
    pixels = []
    for info, shift in zip(infos, (0.0, 0.11)):
        K, R, P = np.reshape(info.K, (3, 3)), np.reshape(info.R, (3, 3)), np.reshape(info.P, (3, 4))
        assert info.distortion_model == name and (info.width, info.height) == (64, 48)
        seen = (points - [shift, 0, 0]).reshape(-1, 1, 3)
        if name == "equidistant":
            assert len(info.D) == 4
            raw = cv2.fisheye.projectPoints(seen, np.zeros(3), np.zeros(3), K, np.array(info.D))[0]
            pixels.append(cv2.fisheye.undistortPoints(raw, K, np.array(info.D), R=R, P=P[:, :3]))
        else:
            assert len(info.D) == 5
            raw = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), K, np.array(info.D))[0]
            pixels.append(cv2.undistortPoints(raw, K, np.array(info.D), R=R, P=P[:, :3]))
    left, right = (p.reshape(-1, 2) for p in pixels)
    baseline = -infos[1].P[3] / infos[1].P[0]
    assert baseline == pytest.approx(0.11) and infos[0].P[3] == 0.0 and infos[0].P[2] == infos[1].P[2]
    assert left[:, 1] == pytest.approx(right[:, 1], abs=0.02)
    depths = (np.reshape(infos[0].R, (3, 3)) @ points.T)[2]
    assert left[:, 0] - right[:, 0] == pytest.approx(infos[0].P[0] * baseline / depths, abs=0.02)


def test_transforms_lead_from_the_imu_to_the_raw_cameras(drive, tmp_path):
    convert(drive("asl"), tmp_path)
    imu_T_cam = inverse(read_reference(str(tmp_path / "out.bag")).cam_T_imu)
    assert np.allclose(imu_T_cam, [[0, 0, 1, 0.1], [-1, 0, 0, 0.05], [0, -1, 0, 0.05], [0, 0, 0, 1]])


def test_a_camchain_says_the_same_as_the_sensors(drive):
    folder = drive("asl")
    expected = load_asl(str(folder), options())
    first = inverse(expected.imu_T_left)
    second = inverse(expected.left_T_right)
    lines = []
    for name, key, matrix in (("cam0", "T_cam_imu", first), ("cam1", "T_cn_cnm1", second)):
        lines.append("%s:\n  %s: %s\n  camera_model: pinhole\n  distortion_model: radtan\n  resolution: [64, 48]\n"
                     "  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00002]\n  intrinsics: [50.0, 51.0, 31.0, 24.5]\n"
                     % (name, key, matrix.tolist()))
        (folder / "mav0" / name / "sensor.yaml").unlink()
    (folder / "dso").mkdir()
    (folder / "dso" / "camchain.yaml").write_text("".join(lines))
    found = load_asl(str(folder), options())
    assert np.allclose(found.imu_T_left, expected.imu_T_left) and np.allclose(found.left_T_right, expected.left_T_right)
    assert np.allclose(found.right.projection, expected.right.projection)
    assert np.allclose(found.left.rectification, expected.left.rectification)


def test_truth_of_the_body_is_moved_to_an_imu_that_is_elsewhere_on_it(tmp_path):
    folder = asl_folder(tmp_path / "drive")
    turned = IMU.replace("data: [1, 0, 0, 0, 0, 1, 0, 0,", "data: [0, -1, 0, 1.0, 1, 0, 0, 2.0,")
    assert turned != IMU
    (folder / "mav0" / "imu0" / "sensor.yaml").write_text(turned)
    table = folder / "mav0" / "state_groundtruth_estimate0"
    table.mkdir()
    (table / "data.csv").write_text("#\n" + "".join("%d,%g,0,0,1,0,0,0\n" % (START + 50000000 * k, k) for k in range(4)))
    stamps, poses = load_asl(str(folder), options()).truth
    assert len(stamps) == 4
    assert np.allclose(poses[0][:3, 3], 0.0) and np.allclose(poses[0][:3, :3], np.eye(3))
    assert np.allclose(poses[3][:3, 3], [0.0, -3.0, 0.0])  # along the body's x, which is the IMU's -y


@pytest.mark.parametrize("kind", ["asl", "kitti odometry"])
def test_a_truth_file_of_another_time_is_refused(kind, drive, tmp_path):
    (tmp_path / "other.tum").write_text("".join("%d 0 0 0 0 0 0 1\n" % t for t in (5000, 5001)))
    folder = drive(kind)
    assert main([str(folder), str(tmp_path / "x.bag"), "--quiet", "--truth", str(tmp_path / "other.tum")]) == 2
    assert not (tmp_path / "x.bag").exists()


def test_a_stamp_that_no_clock_has_is_refused(drive, tmp_path, capsys):
    folder = drive("asl")
    path = folder / "mav0" / "imu0" / "data.csv"
    path.write_text(path.read_text() + "9223372036854775808,0,0,0,0,0,9.8\n")
    assert main([str(folder), str(tmp_path / "x.bag"), "--quiet"]) == 2
    assert "allowed: a stamp in ns" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["state_groundtruth_estimate0", "mocap0"])
def test_truth_begins_with_heading_and_position_zero_and_its_tilt(drive, name):
    folder, tilt = drive("asl"), so3_exp([0.1, 0, 0])
    rows = []
    for k, stamp in enumerate(ASL_STAMPS):
        x, y, z, w = rotation_to_quaternion(so3_exp([0, 0, 1.0]) @ tilt)
        rows.append("%d,%.9f,%.9f,5,%.12f,%.12f,%.12f,%.12f,0,0,0\n" % (stamp, 3 + k * np.cos(1.0), k * np.sin(1.0), w, x, y, z))
    (folder / "mav0" / name).mkdir()
    (folder / "mav0" / name / "data.csv").write_text("#header\n" + "".join(rows))
    stamps, poses = load_asl(str(folder), options()).truth
    assert list(stamps) == list(ASL_STAMPS)
    assert np.allclose(poses[:, :3, 3], [[k, 0, 0] for k in range(4)], atol=1e-6) and np.allclose(poses[2, :3, :3], tilt)


def test_the_velocity_of_oxts_is_along_the_earths_surface_and_is_turned_into_the_axes_of_the_imu():
    slope = 0.1
    row = np.zeros(30)
    row[3:6] = [0.0, -slope, 2.0]  # nose up, heading anywhere
    row[8:11] = [10.0 * np.cos(slope), 0.0, 10.0 * np.sin(slope)]
    assert np.allclose(oxts_velocities(row[None]), [[10.0, 0.0, 0.0]])
    row[3:6], row[8:11] = [0.1, 0.0, 2.0], [10.0, 1.0, 0.0]  # leaning to the right, sliding to the left
    assert np.allclose(oxts_velocities(row[None]), [[10.0, np.cos(0.1), -np.sin(0.1)]])


def test_kitti_raw(drive, tmp_path):
    topics = convert(drive("kitti raw"), tmp_path, "--velocity", "--velocity-sigma", "0.2")
    assert {topic: len(entries) for topic, entries in topics.items()} == {
        "/tf_static": 1, "/ground_truth/path": 1, "/ground_truth/pose": 3, "/imu": 3, "/velocity": 3,
        "/left/camera_info": 3, "/right/camera_info": 3, "/left/image/compressed": 3, "/right/image/compressed": 3}
    stamp, imu = topics["/imu"][0]
    assert stamp == 1317042145 * 10**9 + 100000001  # 2011-09-26 13:02:25 UTC
    assert [imu.angular_velocity.y, imu.linear_acceleration.x, imu.linear_acceleration.z] == [0.02, 0.3, 9.8]
    velocity = topics["/velocity"][0][1].twist
    linear = [velocity.twist.linear.x, velocity.twist.linear.y, velocity.twist.linear.z]
    assert np.allclose(oxts_rotation(0.03, -0.02, 0.0) @ linear, [13.0, -0.1, 0.05]) and velocity.covariance[0] == pytest.approx(0.04)
    left, right = (topics["/%s/camera_info" % side][0][1] for side in ("left", "right"))
    assert list(left.P) == list(PROJECTIONS[0].ravel()) and right.P[3] == pytest.approx(-25.0) and set(left.D) == {0.0}
    camera_in_imu = inverse(read_reference(str(tmp_path / "out.bag")).cam_T_imu)
    assert np.allclose(camera_in_imu[:3, 3], [0.8 + 0.3, 0, -0.3])
    assert np.allclose(camera_in_imu[:3, :3] @ [0, 0, 1], [1, 0, 0])
    assert not [topic for topic in convert(tmp_path / "drive", tmp_path) if topic == "/velocity"]


def test_the_pose_of_an_ins_is_east_north_up():
    rows = np.zeros((2, 30))
    rows[:, 0], rows[1, 1], rows[:, 5] = 49.0, 1e-5, np.pi / 2
    rows[1, 0] += 1e-5
    poses = oxts_poses(rows)
    assert poses[1, :2, 3] == pytest.approx([np.radians(1e-5) * 6378137 * np.cos(np.radians(49)), np.radians(1e-5) * 6378137],
                                            rel=1e-4)
    assert np.allclose(poses[0, :3, :3] @ [1, 0, 0], [0, 1, 0])
    # At rest the accelerometer feels g upwards: nose up by a negative pitch, leaning right by a positive roll.
    assert np.allclose(oxts_rotation(0.1, 0, 0).T @ [0, 0, 1], [0, np.sin(0.1), np.cos(0.1)])


def test_kitti_odometry(drive, tmp_path):
    topics = convert(drive("kitti odometry"), tmp_path)
    assert "/imu" not in topics and len(topics["/left/image/compressed"]) == 3
    assert [stamp for stamp, _ in topics["/right/camera_info"]] == [1000000000, 1103622400, 1207244800]
    path = topics["/ground_truth/path"][0][1]
    assert [p.pose.position.x for p in path.poses] == pytest.approx([0, 1, 2])  # along the body's x, forward


def test_a_truth_file_of_ones_own(drive, tmp_path):
    folder = drive("kitti odometry")
    (folder / "poses.txt").unlink()
    assert "/ground_truth/path" not in convert(folder, tmp_path)
    (tmp_path / "mine.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    assert len(convert(folder, tmp_path, "--truth", str(tmp_path / "mine.txt"))["/ground_truth/path"][0][1].poses) == 1
    (tmp_path / "mine.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 4)
    assert main([str(folder), str(tmp_path / "x.bag"), "--quiet", "--truth", str(tmp_path / "mine.txt")]) == 2


@pytest.mark.parametrize("kind", ["kitti raw", "kitti odometry"])
def test_surplus_rows_of_the_truth_are_named_and_left_out_when_asked(drive, tmp_path, capfd, kind):
    folder, truth = drive(kind), tmp_path / "long.txt"
    truth.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 5)
    assert main([str(folder), str(tmp_path / "x.bag"), "--quiet", "--truth", str(truth)]) == 2
    assert "long.txt: has 5 rows, the drive 3 frames (--skip-bad leaves them out)" in capfd.readouterr().err
    path = convert(folder, tmp_path, "--truth", str(truth), "--skip-bad")["/ground_truth/path"][0][1]
    assert len(path.poses) == 3


def test_rows_counted_by_frames_are_refused_where_frames_are_left_out(drive, tmp_path, capfd):
    folder, truth = drive("asl"), tmp_path / "rows.txt"
    truth.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2)
    command = [str(folder), str(tmp_path / "x.bag"), "--quiet", "--skip-bad", "--truth", str(truth)]
    assert main(command) == 0
    missing(folder / "mav0" / "cam1" / "data" / ("%d.png" % ASL_STAMPS[0]))
    assert main(command) == 2 and "rows.txt: is in KITTI's format, whose rows are counted by frames" in capfd.readouterr().err


def missing(path):
    path.unlink()


def cut(path):
    path.write_bytes(path.read_bytes()[:-20])


def other_size(path):
    picture(path, 1, (32, 48))


def surplus(path):
    shutil.copy(str(path), str(path.parent / ("0000009" + path.suffix)))


@pytest.mark.parametrize("damage", [missing, cut, other_size, surplus])
@pytest.mark.parametrize("kind, name", [("asl", "mav0/cam1/data/%d.png" % ASL_STAMPS[1]),
                                        ("kitti raw", "image_01/data/0000000001.png"),
                                        ("kitti odometry", "image_0/000001.png")])
def test_bad_pictures_are_named_and_left_out_when_asked(drive, tmp_path, capfd, kind, name, damage):
    folder = drive(kind)
    damage(folder / name)
    assert main([str(folder), str(tmp_path / "out.bag")]) == 2
    complaint = capfd.readouterr().err
    assert complaint.count("\n") == 1 and "--skip-bad" in complaint
    assert os.path.splitext(os.path.basename(name))[0] in complaint or "0000009" in complaint
    assert sorted(path.name for path in tmp_path.iterdir()) == ["drive"]
    kept = len(convert(folder, tmp_path, "--skip-bad")["/left/image/compressed"])
    assert kept == (4 if kind == "asl" else 3) - (damage is not surplus)


@pytest.mark.parametrize("text", ["", "1 2 3\n", "nan " * 30 + "\n"])
def test_a_damaged_row_of_the_ins_is_named_and_left_out_when_asked(drive, text):
    folder = drive("kitti raw")
    (folder / "oxts" / "data" / "0000000001.txt").write_text(text)
    with pytest.raises(InputError, match="0000000001.txt.*--skip-bad"):
        load_kitti_raw(str(folder), options())
    recording = load_kitti_raw(str(folder), options(skip_bad=True))
    assert len(recording.imu.stamps) == 2 and any("0000000001.txt" in note for note in recording.notes)


@pytest.mark.parametrize("kind, name, text, complaint", [
    ("asl", "mav0/cam0/sensor.yaml", "a: [", "cannot be read"),
    ("asl", "mav0/cam0/sensor.yaml", "resolution: [64, 48]\n", "intrinsics is missing"),
    ("asl", "mav0/imu0/data.csv", "#t\n5,1,2,3\n", "line 2 is '5,1,2,3'"),
    ("asl", "mav0/imu0/data.csv", "7,1,2,3,4,5,6\n5,1,2,3,4,5,6\n", "is not increasing"),
    ("asl", "mav0/imu0/sensor.yaml", "gyroscope_noise_density: -1\n", "is -1 rad/s/sqrt(Hz)"),
    ("asl", "mav0/imu0/sensor.yaml", "gyroscope_noise_density: 1e200\n", "is 1e+200 rad/s/sqrt(Hz), allowed: up to 1e+06"),
    ("asl", "mav0/cam1/data.csv", "x,y\n", "line 1 begins with 'x'"),
    ("kitti raw", "calib_velo_to_cam.txt", "R: 1 2 3\nT: 0 0 0\n", "R is ' 1 2 3', allowed: 9 numbers"),
    ("kitti raw", "calib_cam_to_cam.txt", "S_rect_00: 64 48\n", "key 'P_rect_00' is missing"),
    ("kitti raw", "image_00/timestamps.txt", "yesterday\n", "line 1 is 'yesterday'"),
    ("kitti odometry", "times.txt", "0\n0.1\nx\n", "times.txt"),
    ("kitti odometry", "calib.txt", "P0: 1\n", "P0 is ' 1', allowed: 12 numbers")])
def test_what_is_wrong_is_named(drive, tmp_path, capfd, kind, name, text, complaint):
    folder = drive(kind)
    (folder / name).write_text(text)
    assert main([str(folder), str(tmp_path / "out.bag"), "--quiet"]) == 2
    error = capfd.readouterr().err
    assert complaint in error and str(folder) in error and error.count("\n") == 1
    assert not (tmp_path / "out.bag").exists()


def test_other_folders_are_refused(tmp_path, capfd):
    assert main([str(tmp_path), str(tmp_path / "out.bag")]) == 2
    assert "is no drive, allowed: one with mav0/cam0" in capfd.readouterr().err
    (tmp_path / "mav0" / "cam0").mkdir(parents=True)
    assert main([str(tmp_path), str(tmp_path / "out.bag")]) == 2
    assert "has no folder cam1" in capfd.readouterr().err


@pytest.mark.parametrize("focal_length", [285.0, 190.0, 150.0])  # sees 51, 77 and 98 deg to the sides
def test_a_fisheye_keeps_its_focal_length(focal_length):
    """However much it sees: OpenCV would have a plane hold all of it, with 58 px of 190 px, and 4 px of 150 px."""
    K = np.array([[focal_length, 0, 250], [0, focal_length, 260], [0, 0, 1]])
    left, right = (RawCamera((512, 512), K, "equidistant", np.array([0.0035, 0.0007, -0.002, 0.0002]),
                             make_transform(so3_exp([0.0, 0.0, turn]), [x, 0, 0])) for x, turn in ((0, 0), (0.1, 0.01)))
    left, right = rectify(left, right, "here")
    assert left.projection[0] == pytest.approx([focal_length, 0, 255.5, 0]) and left.projection[1, 1] == pytest.approx(focal_length)
    assert right.projection == pytest.approx(left.projection - [[0, 0, 0, 0.1 * focal_length], [0] * 4, [0] * 4])


def test_cameras_in_the_wrong_order_are_refused():
    K = np.array([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]])
    left, right = (RawCamera((64, 48), K, "plumb_bob", np.zeros(5), make_transform(np.eye(3), [x, 0, 0])) for x in (0, 0.1))
    rectify(left, right, "here")
    with pytest.raises(InputError, match="here: the second camera is at .*allowed: to its right"):
        rectify(right, left, "here")


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_cameras_one_above_the_other_are_turned_side_by_side(model, side):
    """A pair mounted on its side, either way round: with R and P a point is in one row, b f / z further left on the right."""
    K = np.array([[50.0, 0, 23], [0, 52, 33], [0, 0, 1]])
    distortion = np.array([-0.2, 0.05, 0, 0, 0][:4 if model == "equidistant" else 5])
    cameras = [RawCamera((48, 64), K, model, distortion, make_transform(so3_exp([0.0, 0.0, turn]), [0.002, y, 0]))
               for y, turn in ((0.0, 0.0), (side, 0.02))]
    point, pixels = np.array([0.3, -0.2, 2.0, 1.0]), []
    for raw, camera in zip(cameras, rectify(*cameras, "here")):
        seen = camera.projection @ np.append(camera.rectification @ (inverse(raw.imu_T_cam) @ point)[:3], 1.0)
        # P of ROS has the baseline in it: of a point of the left rectified frame.
        pixels.append((seen - camera.projection[:, 3])[:2] / seen[2])
        assert camera.size == (48, 64) and camera.intrinsics is K and np.linalg.det(camera.rectification) == pytest.approx(1.0)
        assert 0.0 < camera.projection[0, 2] < 64.0 and 0.0 < camera.projection[1, 2] < 48.0
    baseline = -camera.projection[0, 3] / camera.projection[0, 0]
    assert baseline == pytest.approx(0.1) and camera.projection[1, 3] == 0.0
    disparity = pixels[0] - pixels[1]
    assert disparity == pytest.approx([camera.projection[0, 0] * baseline / seen[2], 0.0], abs=1e-9)


def test_cameras_that_are_turned_against_each_other_are_refused():
    K = np.array([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]])
    for model in ("plumb_bob", "equidistant"):
        for turn in (np.pi, -0.5 * np.pi, 0.5):
            left, right = (RawCamera((64, 48), K, model, np.zeros(4), make_transform(so3_exp([0, 0, angle]), [x, 0, 0]))
                           for x, angle in ((0, 0), (0.1, turn)))
            with pytest.raises(InputError, match="here: the pictures of the cameras are turned by %.0f deg" % np.degrees(abs(turn))):
                rectify(left, right, "here")


def test_sizes_are_read_from_the_headers(tmp_path):
    for suffix in (".png", ".jpg"):
        picture(tmp_path / ("a" + suffix), 1, (70, 33))
        assert image_size(str(tmp_path / ("a" + suffix))) == (70, 33)


def test_the_two_truths_of_a_real_drive_agree():
    """The left camera's poses carried to the IMU, and the INS's own: a wrong extrinsic or axis would part them."""
    folder = os.path.dirname(data_file("images/kitti_2011_09_26_0001/truth_left_camera.txt"))
    stamps, poses = load_kitti_raw(folder, options()).truth
    ins = oxts_poses(read_oxts(os.path.join(folder, "oxts"), Faults(False))[1])
    position, orientation = errors_after_yaw_alignment(poses, ins)
    assert len(poses) == 108 and position < 0.1 and orientation < 0.5


def test_the_velocity_of_a_real_drive_is_that_of_its_own_poses():
    """Along the earth's surface it would point 12 mrad down: the car's nose is up."""
    folder = os.path.dirname(data_file("images/kitti_2011_09_26_0001/truth_left_camera.txt"))
    stamps, rows = read_oxts(os.path.join(folder, "oxts"), Faults(False))
    poses, velocities = oxts_poses(rows), oxts_velocities(rows)
    way = np.diff(poses[:, :3, 3], axis=0) / np.diff(1e-9 * stamps)[:, None]
    along_axes = np.einsum("nji,nj->ni", poses[:-1, :3, :3], way)
    assert abs(np.mean(along_axes - velocities[:-1], axis=0)[2]) < 0.03


def test_a_real_drive_of_euroc():
    folder = os.path.dirname(data_file("images/euroc_mh01/truth_imu.tum"))
    recording = load_asl(folder, options())
    assert len(recording.images.stamps) == 600 and recording.imu.noise.accelerometer_density == 2e-3
    # In the mean over the drive, whose velocity changes little, the accelerometer feels gravity from below.
    near = int(np.searchsorted(recording.imu.stamps, recording.truth[0][0]))
    poses = recording.truth[1]
    felt = poses[:, :3, :3] @ recording.imu.acceleration[near:near + len(poses), :, None]
    assert np.mean(felt, axis=0)[:, 0] == pytest.approx([0, 0, 9.81], abs=0.3)


@pytest.mark.parametrize("kind, option, complaint", [
    ("asl", ["--velocity"], "--velocity is given, allowed for a raw drive of KITTI"),
    ("kitti raw", ["--keep-stale"], "--keep-stale is given, allowed for an .npz with a velocity"),
    ("kitti odometry", ["--gyro-sigma", "0.1"], "--gyro-sigma is given, allowed for an .npz with a velocity")])
def test_options_that_would_do_nothing_are_refused(drive, tmp_path, capfd, kind, option, complaint):
    assert main([str(drive(kind)), str(tmp_path / "out.bag")] + option) == 2
    assert complaint in capfd.readouterr().err and not (tmp_path / "out.bag").exists()
