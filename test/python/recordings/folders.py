"""Small drives as folders, made in a test's own directory."""

import argparse

import cv2
import numpy as np
import rosbag

from vi_ekf_slam.bag.converter import main

SIZE = (64, 48)
START = 1403636579763555584  # ns, more digits than a float of seconds holds
ASL_STAMPS = START + 50000000 * np.arange(4)
SENSOR = """sensor_type: camera
T_BS: {cols: 4, rows: 4, data: [0, 0, 1, %g, -1, 0, 0, %g, 0, -1, 0, 0.05, 0, 0, 0, 1]}
resolution: [64, 48]
camera_model: pinhole
intrinsics: [50.0, 51.0, 31.0, 24.5]
distortion_model: %s
distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]
"""
IMU = """T_BS: {data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
rate_hz: 200
gyroscope_noise_density: 1.0e-04
gyroscope_random_walk: 2.0e-05
accelerometer_noise_density: 2.0000e-3
accelerometer_random_walk: 3.0000e-3
"""


def options(**changes):
    """What the converter's command line sets."""
    values = dict(calibration=None, skip_bad=False, truth=None, truth_body=None, velocity=False, velocity_sigma=0.1)
    return argparse.Namespace(**dict(values, **changes))


def picture(path, seed, size=SIZE):
    """A noise image; its format is that of the path's suffix."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 255, (size[1], size[0]), dtype=np.uint8)
    assert cv2.imwrite(str(path), pixels)


def asl_folder(root, model="radial-tangential", suffix=".png"):
    """Four stereo pairs at 20 Hz and 41 IMU samples at 200 Hz, in EuRoC's layout."""
    base = root / "mav0"
    for k, (name, x, y) in enumerate((("cam0", 0.1, 0.05), ("cam1", 0.1, -0.06))):
        for n, stamp in enumerate(ASL_STAMPS):
            picture(base / name / "data" / ("%d%s" % (stamp, suffix)), 10 * k + n)
        (base / name / "data.csv").write_text("#timestamp [ns],filename\r\n" + "".join(
            "%d,%d%s\r\n" % (stamp, stamp, suffix) for stamp in ASL_STAMPS))
        (base / name / "sensor.yaml").write_text(SENSOR % (x, y, model))
    (base / "imu0").mkdir()
    (base / "imu0" / "sensor.yaml").write_text(IMU)
    (base / "imu0" / "data.csv").write_text("#timestamp,w,w,w,a,a,a\n" + "".join(
        "%d,0.1,0.2,%g,0.5,-0.25,9.8\n" % (START + 5000000 * k, 0.01 * k) for k in range(41)))
    return root


def kitti_lines(values):
    return "".join("%s: %s\n" % (key, " ".join("%.9e" % v for v in np.ravel(value))) for key, value in values.items())


PROJECTIONS = [np.array([[50.0, 0, 31, offset], [0, 50.0, 24, 0], [0, 0, 1, 0]]) for offset in (0.0, -25.0)]
VELO_R_CAM = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def kitti_raw_folder(root):
    """Three stereo pairs and oxts at 10 Hz; the IMU is 0.8 m behind and 0.3 m above the Velodyne, that 0.3 m behind the camera."""
    times = "".join("2011-09-26 13:02:%02d.%09d\n" % (25, 100000000 * (k + 1) + 1) for k in range(3))
    for name in ("image_00", "image_01"):
        for k in range(3):
            picture(root / name / "data" / ("%010d.png" % k), k)
        (root / name / "timestamps.txt").write_text(times)
    (root / "oxts" / "data").mkdir(parents=True)
    (root / "oxts" / "timestamps.txt").write_text(times)
    for k in range(3):
        row = np.zeros(30)
        row[:6] = [49.0, 8.4 + 1e-5 * k, 116.0, 0.03, -0.02, 0.1]
        row[8:11], row[11:14], row[17:20] = [13.0, -0.1, 0.05], [0.3, 0.2, 9.8], [0.01, 0.02, 0.03]
        row[14:17], row[20:23] = [7.0, 7, 7], [8.0, 8, 8]  # of other axes: must not be used
        (root / "oxts" / "data" / ("%010d.txt" % k)).write_text(" ".join("%.15g" % v for v in row) + "\n")
    (root / "calib_imu_to_velo.txt").write_text("calib_time: now\n" + kitti_lines({"R": np.eye(3), "T": [-0.8, 0, 0.3]}))
    (root / "calib_velo_to_cam.txt").write_text(kitti_lines({"R": VELO_R_CAM.T, "T": VELO_R_CAM.T @ [-0.3, 0.0, 0.0]}))
    (root / "calib_cam_to_cam.txt").write_text(kitti_lines({
        "S_rect_00": SIZE, "R_rect_00": np.eye(3), "P_rect_00": PROJECTIONS[0], "P_rect_01": PROJECTIONS[1]}))
    return root


def kitti_odometry_folder(root):
    """Three stereo pairs; the car drives 1 m a frame."""
    for name in ("image_0", "image_1"):
        for k in range(3):
            picture(root / name / ("%06d.png" % k), k)
    (root / "calib.txt").write_text(kitti_lines({"P0": PROJECTIONS[0], "P1": PROJECTIONS[1]}))
    (root / "times.txt").write_text("0.000000e+00\n1.036224e-01\n2.072448e-01\n")
    (root / "poses.txt").write_text("".join("1 0 0 0 0 1 0 0 0 0 1 %d\n" % k for k in range(3)))
    return root


MAKERS = {"asl": asl_folder, "kitti raw": kitti_raw_folder, "kitti odometry": kitti_odometry_folder}


def convert(folder, tmp_path, *more):
    """Messages of the bag by topic: (ns, message)."""
    path = str(tmp_path / "out.bag")
    assert main([str(folder), path, "--quiet", *more]) == 0
    topics = {}
    with rosbag.Bag(path) as bag:
        for topic, message, stamp in bag.read_messages():
            topics.setdefault(topic, []).append((stamp.to_nsec(), message))
    return topics


def assert_same_rig(rig, other):
    """Of two rig_calibration.RigCalibration."""
    for one, two in ((rig.left, other.left), (rig.right, other.right)):
        assert one.size == two.size and one.model == two.model
        for k in (1, 3, 4, 5):
            np.testing.assert_allclose(one[k], two[k], atol=1e-9)
    np.testing.assert_allclose(rig.imu_T_left, other.imu_T_left, atol=1e-9)
    np.testing.assert_allclose(rig.left_T_right, other.left_T_right, atol=1e-9)
