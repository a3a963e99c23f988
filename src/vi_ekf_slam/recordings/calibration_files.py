"""Calibration as YAML: the sensor.yaml of ASL folders, and Kalibr's camchain."""

import numpy as np

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse, so3_log
from vi_ekf_slam.common.yaml_file import read_mapping
from vi_ekf_slam.dataset.extrinsic import ROTATION_TOLERANCE, check_transform
from vi_ekf_slam.recordings.rectification import MODELS, RawCamera

MAX_TIME_OFFSET = 1.0  # s


def sensor_pose(values, path):
    """body_T_sensor (4 x 4) of a sensor.yaml's T_BS; the identity without one."""
    if "T_BS" not in values:
        return np.eye(4)
    matrix = values["T_BS"]
    return transform(matrix.get("data") if isinstance(matrix, dict) else matrix, "%s: T_BS" % path)


def sensor_camera(path, body_T_imu):
    """RawCamera of a camera's sensor.yaml. body_T_imu: of the IMU's."""
    values = read_mapping(path)
    return _camera(values, path, "distortion_coefficients", inverse(body_T_imu) @ sensor_pose(values, path))


def camchain(path, imu_T_left=None):
    """(left, right) RawCamera of Kalibr's camchain with cam0 and cam1, or of OpenVINS', which may state the inverse of T_cam_imu.

    imu_T_left: 4 x 4 or None, where the left camera is if the file does not say it.
    """
    values, cameras = read_mapping(path), []
    for name in ("cam0", "cam1"):
        camera, where = values.get(name), "%s: %s" % (path, name)
        if not isinstance(camera, dict):
            raise InputError("%s is missing, allowed: Kalibr's camchain with cam0 and cam1 (of KITTI the folder, of ROS's "
                             "camera_calibration two files)" % where)
        if "T_cam_imu" in camera:
            imu_T_cam = inverse(transform(camera["T_cam_imu"], where + ": T_cam_imu"))
        elif "T_imu_cam" in camera:
            imu_T_cam = transform(camera["T_imu_cam"], where + ": T_imu_cam")
        elif cameras and "T_cn_cnm1" in camera:
            imu_T_cam = cameras[0].imu_T_cam @ inverse(transform(camera["T_cn_cnm1"], where + ": T_cn_cnm1"))
        elif not cameras and imu_T_left is not None:
            imu_T_cam = imu_T_left
        else:
            raise InputError("%s: T_cam_imu is missing: where is the camera on the IMU? --imu-T-left FILE says it of cam0" % where)
        cameras.append(_camera(camera, where, "distortion_coeffs", imu_T_cam))
    return tuple(cameras)


def timeshift(path, name="cam0"):
    """s that Kalibr's camchain has to be added to a picture's stamp for the IMU's clock; None where it says nothing."""
    shift, where = read_mapping(path)[name].get("timeshift_cam_imu"), "%s: %s: timeshift_cam_imu" % (path, name)
    if shift is None:
        return None
    shift = float(numbers(shift, (), where))
    if abs(shift) > MAX_TIME_OFFSET:
        raise InputError("%s is %g s, allowed: -%g to %g" % (where, shift, MAX_TIME_OFFSET, MAX_TIME_OFFSET))
    return shift


def contradictions(path, left, right):
    """Lines of text: what a camchain says of both cameras and not alike. left, right: what camchain() takes of it."""
    lines, first, second = [], timeshift(path), timeshift(path, "cam1")
    if first is None and second is not None:
        lines.append("clock: cam1 has a timeshift_cam_imu of %.3f ms, cam0 has none: none is taken" % (1e3 * second))
    elif second is not None and round(1e3 * (second - first), 3) != 0.0:
        lines.append("clock: timeshift_cam_imu of cam1 differs by %.3f ms from that of cam0, which is taken" % (1e3 * (second - first)))
    stated = read_mapping(path)["cam1"].get("T_cn_cnm1")
    if stated is not None:
        error = inverse(transform(stated, path + ": cam1: T_cn_cnm1")) @ inverse(right.imu_T_cam) @ left.imu_T_cam
        turn, way = np.linalg.norm(so3_log(error[:3, :3])), np.linalg.norm(error[:3, 3])
        if max(turn, way) > ROTATION_TOLERANCE:  # of the digits that files keep: rad, m
            lines.append("cam1: T_cn_cnm1 is %.2f deg and %.1f mm from what is taken, the transforms of both cameras to the IMU"
                         % (np.degrees(turn), 1e3 * way))
    return lines


def _camera(values, path, distortion_key, imu_T_cam):
    if values.get("camera_model", "pinhole") != "pinhole":
        raise InputError("%s: camera_model is '%s', allowed: pinhole (Kalibr's pinhole-radtan; pinhole-equi for a wide lens)"
                         % (path, values["camera_model"]))
    if "distortion_model" not in values and values.get(distortion_key):
        raise InputError("%s: distortion_model is missing, of which %s are, allowed: %s"
                         % (path, distortion_key, ", ".join(sorted(MODELS))))
    model = str(values.get("distortion_model", "none"))
    if model not in MODELS:
        raise InputError("%s: distortion_model is '%s', allowed: %s" % (path, model, ", ".join(sorted(MODELS))))
    fu, fv, cu, cv = numbers(values.get("intrinsics"), (4,), path + ": intrinsics")
    intrinsics = np.array([[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]])
    checks.require_intrinsics(intrinsics, path + ": intrinsics")
    width, height = numbers(values.get("resolution"), (2,), path + ": resolution")
    if min(width, height) < 1.0:
        raise InputError("%s: resolution is %g x %g px, allowed: from 1 px on" % (path, width, height))
    distortion = np.zeros(4)
    if model != "none":
        distortion = numbers(values.get(distortion_key), (None,), path + ": " + distortion_key)
    allowed = (4,) if MODELS[model] == "equidistant" else (4, 5)
    if len(distortion) not in allowed:
        raise InputError("%s: %s has %d numbers, allowed: %s"
                         % (path, distortion_key, len(distortion), " or ".join(map(str, allowed))))
    if MODELS[model] == "plumb_bob":
        distortion = np.append(distortion, np.zeros(5 - len(distortion)))  # k1 k2 p1 p2 k3, as CameraInfo has it
    return RawCamera((int(width), int(height)), intrinsics, MODELS[model], distortion, imu_T_cam)


def numbers(values, shape, name):
    """A finite array of this shape (None: any length) of what YAML gives; InputError names `name`."""
    if values is None:
        raise InputError("%s is missing" % name)
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError("%s is %r, allowed: numbers" % (name, values))
    checks.require_shape(array, shape, name)
    checks.require_finite(array, name)
    return array


def matrix(values, shape, name):
    """The same of what gives its rows one after the other."""
    array = numbers(values, (None,), name)
    if array.size != np.prod(shape):
        raise InputError("%s has %d numbers, allowed: %d" % (name, array.size, np.prod(shape)))
    return array.reshape(shape)


def transform(values, name):
    """4 x 4 rigid transform of 16 numbers, row by row; InputError names `name`."""
    try:
        array = np.array(values, dtype=float).reshape(4, 4)
    except (TypeError, ValueError):
        raise InputError("%s is %r, allowed: 16 numbers" % (name, values))
    checks.require_finite(array, name)
    return check_transform(array, name)
