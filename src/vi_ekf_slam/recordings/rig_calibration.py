"""The calibration of a rig, whatever wrote it: Kalibr, ROS's camera_calibration, EuRoC and TUM-VI, KITTI."""

import glob
import os
from collections import namedtuple

import numpy as np

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse, make_transform
from vi_ekf_slam.common.yaml_file import read_mapping
from vi_ekf_slam.dataset.extrinsic import check_transform
from vi_ekf_slam.recordings import asl
from vi_ekf_slam.recordings.calibration_files import (camchain, contradictions, matrix, numbers, sensor_camera,
                                                      sensor_pose, timeshift, transform)
from vi_ekf_slam.recordings.imu_noise import KEYS, noise_from_yaml
from vi_ekf_slam.recordings.kitti import calibrated_pair
from vi_ekf_slam.recordings.recording import Camera
from vi_ekf_slam.recordings.rectification import rectify, side_by_side

# sensor_msgs/CameraInfo's distortion models and how many coefficients each has, as the node takes them (front_end/camera_model.cpp).
ROS_MODELS = {"plumb_bob": (4, 5, 8, 12, 14), "rational_polynomial": (4, 5, 8, 12, 14), "equidistant": (4,), "fisheye": (4,)}
# ROS's camera_calibration's keys -> those of sensor_msgs/CameraInfo, as `rostopic echo` writes it.
INFO_KEYS = {"image_width": "width", "image_height": "height", "camera_matrix": "K", "distortion_coefficients": "D",
             "rectification_matrix": "R", "projection_matrix": "P"}
# As the node has them (ros/input/rig_assembler.cpp).
PIXEL_TOLERANCE = 1e-3  # px, between P of both sides
MAX_VERTICAL = 0.01  # of the baseline: rows would differ by so much of the disparity, half a pixel of 50

RigCalibration = namedtuple("RigCalibration", "format left right imu_T_left left_T_right noise time_offset notes", defaults=((),))
RigCalibration.__doc__ = """format: text. left, right: recording.Camera. imu_T_left, left_T_right: 4 x 4, of the cameras as
mounted where the pictures are raw. noise: imu_noise.ImuNoise, or None: not stated. time_offset: s to be added to a picture's stamp for the IMU's clock, or None.
notes: lines of text, where the calibration contradicts itself."""


def without_surplus(model, distortion):
    """D without the zeros that drivers fill a fisheye's four coefficients up with, as the node takes it."""
    return distortion[:4] if ROS_MODELS.get(model) == (4,) and not np.any(distortion[4:]) else distortion


def read_calibration(paths, imu=None, imu_T_left=None):
    """RigCalibration of a folder, of one file or of two (left, right); InputError says what is missing or wrong.

    imu: a file with the IMU's noise (Kalibr's imu.yaml, sensor.yaml). imu_T_left: a file with where the left camera is, for
    formats that do not say it.
    """
    for path in list(paths) + [p for p in (imu, imu_T_left) if p]:
        if not os.path.exists(path):
            raise InputError("%s: no such file or folder" % path)
    given = None if imu_T_left is None else _camera_on_imu(imu_T_left)
    if len(paths) == 1 and os.path.isdir(paths[0]):
        rig = _folder(paths[0], given)
    elif len(paths) == 1:
        rig = _kalibr(paths[0], given)
    elif len(paths) == 2:
        rig = _two_files(paths, imu, given)
    else:
        raise InputError("%d files are given, allowed: one folder, one camchain, or left and right" % len(paths))
    if given is not None:
        rig = rig._replace(imu_T_left=given)
    if imu is not None:
        rig = rig._replace(noise=read_noise(imu))
    return rig


def read_noise(path):
    """ImuNoise of Kalibr's imu.yaml or of a sensor.yaml."""
    values = read_mapping(path)
    values = values.get("imu0", values) or {}
    return noise_from_yaml(values, "rate_hz" if "rate_hz" in values else "update_rate", path)


def _folder(folder, imu_T_left):
    base = asl.base_of(folder)
    if base:
        chain = asl.find(folder, base, "*camchain*.yaml")  # as the converter looks for it
        return _kalibr(chain, imu_T_left)._replace(noise=asl.noise_of(folder, base)) if chain else _asl(base)
    for place in (folder, os.path.dirname(os.path.abspath(folder))):
        if os.path.exists(os.path.join(place, "calib_cam_to_cam.txt")):
            left, right, rectleft_T_imu, baseline = calibrated_pair(
                *(os.path.join(place, "calib_%s.txt" % name) for name in ("cam_to_cam", "imu_to_velo", "velo_to_cam")))
            return RigCalibration("KITTI, rectified pictures", left, right, inverse(rectleft_T_imu),
                                  make_transform(np.eye(3), [baseline, 0.0, 0.0]), None, None)
    chains = sorted(glob.glob(os.path.join(glob.escape(folder), "*camchain*.yaml")))
    if len(chains) == 1:
        return _kalibr(chains[0], imu_T_left)
    raise InputError("%s: is no calibration, allowed: a folder with cam0, cam1 and imu0 (EuRoC, TUM-VI), with "
                     "calib_cam_to_cam.txt (KITTI), or with one *camchain*.yaml (Kalibr)" % folder)


def _kalibr(path, imu_T_left):
    left, right = camchain(path, imu_T_left)
    return _raw("Kalibr's camchain", (left, right), path, None, timeshift(path))._replace(notes=contradictions(path, left, right))


def _asl(base):
    imu = os.path.join(base, "imu0", "sensor.yaml")
    if not os.path.exists(imu):
        raise InputError("%s: no such file; Kalibr's camchain can be given instead of the folder" % imu)
    raw = [sensor_camera(os.path.join(base, name, "sensor.yaml"), sensor_pose(read_mapping(imu), imu))
           for name in ("cam0", "cam1")]
    return _raw("EuRoC's sensor.yaml", raw, base, read_noise(imu) if KEYS[0] in read_mapping(imu) else None, None)


def _raw(name, cameras, source, noise, shift):
    left, right = cameras
    return RigCalibration(name, *rectify(left, right, source), left.imu_T_cam,
                          inverse(left.imu_T_cam) @ right.imu_T_cam, noise, shift)


def _two_files(paths, imu, imu_T_left):
    if "intrinsics" in read_mapping(paths[0]):
        body_T_imu = np.eye(4) if imu is None else sensor_pose(read_mapping(imu), imu)
        return _raw("EuRoC's sensor.yaml", [sensor_camera(path, body_T_imu) for path in paths], paths[0], None, None)
    if imu_T_left is None:
        raise InputError("%s: does not say where the left camera is on the IMU, allowed: with --imu-T-left FILE" % paths[0])
    left, right = (_ros_camera(path) for path in paths)
    if left.size != right.size:
        raise InputError("%s: the size is %d x %d px, that of %s %d x %d px, allowed: the same"
                         % (paths[1], *right.size, paths[0], *left.size))
    for row, column, name in ((0, 0, "fx"), (1, 1, "fy"), (0, 2, "cx"), (1, 2, "cy")):
        values = [camera.projection[row, column] for camera in (right, left)]
        if abs(values[0] - values[1]) > PIXEL_TOLERANCE:
            raise InputError("%s: %s of projection_matrix is %.6g px, that of %s %.6g px, allowed: the same, of a rectified pair"
                             % (paths[1], name, values[0], paths[0], values[1]))
    left, right = side_by_side(left, right)
    baseline, aside = -right.projection[:2, 3] / right.projection[0, 0] + 0.0
    checks.require_positive(baseline, "%s: baseline of projection_matrix, -P[3] / P[0]" % paths[1], "m")
    if left.projection[:, 3].any():
        raise InputError("%s: the last column of projection_matrix is not 0, allowed: 0, as of the first camera of a pair" % paths[0])
    if abs(aside) > MAX_VERTICAL * baseline:
        raise InputError("%s: projection_matrix has a baseline of %.4g m and %.4g m across it, allowed: %g of it, as of a rectified pair"
                         % (paths[1], baseline, aside, MAX_VERTICAL))
    left_T_right = inverse(make_transform(left.rectification, np.zeros(3))) @ make_transform(
        right.rectification, [baseline, 0.0, 0.0])
    return RigCalibration("ROS's camera_calibration", left, right, imu_T_left, left_T_right, None, None)


def _ros_camera(path):
    values = read_mapping(path)

    def entry(key):
        """(what is under that key, or under that of a message; text that names it)."""
        found = INFO_KEYS[key] if key not in values and INFO_KEYS[key] in values else key
        data = values.get(found)
        return data.get("data") if isinstance(data, dict) else data, "%s: %s" % (path, found)

    def array(key, shape):
        data, name = entry(key)
        return matrix(data, shape, name), name
    width, height = (int(numbers(data, (), name)) for data, name in map(entry, ("image_width", "image_height")))
    data, name = entry("distortion_coefficients")
    distortion, model = numbers(data, (None,), name), values.get("distortion_model", "plumb_bob")
    if not model and not distortion.any():
        model = "plumb_bob"
    if model not in ROS_MODELS:
        raise InputError("%s: distortion_model is '%s', allowed: %s" % (path, model, ", ".join(sorted(ROS_MODELS))))
    distortion = without_surplus(model, distortion)
    if ROS_MODELS[model] != (4,) and not distortion.size:
        distortion = np.zeros(5)  # of a picture that is rectified
    if distortion.size not in ROS_MODELS[model]:
        raise InputError("%s has %d numbers, allowed with %s: %s"
                         % (name, distortion.size, model, " or ".join(map(str, ROS_MODELS[model]))))
    intrinsics, name = array("camera_matrix", (3, 3))
    checks.require_intrinsics(intrinsics, name)
    projection, name = array("projection_matrix", (3, 4))
    checks.require_intrinsics(projection[:, :3], name)
    rotation, name = array("rectification_matrix", (3, 3))
    rotation = rotation if rotation.any() else np.eye(3)  # as the node takes it
    rotation = check_transform(make_transform(rotation, np.zeros(3)), name)[:3, :3]
    if model == "plumb_bob" and distortion.size == 4:
        distortion = np.append(distortion, 0.0)
    return Camera((width, height), intrinsics, "equidistant" if model == "fisheye" else model, distortion, rotation, projection)


def _camera_on_imu(path):
    values = read_mapping(path)
    for key in ("imu_T_left", "T_BS", "T_imu_cam", "T_cam_imu"):
        if key in values:
            entry = values[key]
            matrix = transform(entry.get("data") if isinstance(entry, dict) else entry, "%s: %s" % (path, key))
            return inverse(matrix) if key == "T_cam_imu" else matrix
    raise InputError("%s: allowed: imu_T_left, T_BS or T_imu_cam (points of the left camera to the IMU), or T_cam_imu, of 16 numbers" % path)
