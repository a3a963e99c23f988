"""Two calibrated cameras as ROS states them: distortion of each, and the rotation and projection of the rectified pair."""

from collections import namedtuple

import numpy as np

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse
from vi_ekf_slam.recordings.recording import Camera

RawCamera = namedtuple("RawCamera", "size intrinsics model distortion imu_T_cam")
RawCamera.__doc__ = """size (width, height); intrinsics (3, 3) px; model: of MODELS; distortion (4,) or (5,); imu_T_cam 4 x 4."""

# Names in calibration files -> sensor_msgs/CameraInfo's distortion_model.
MODELS = {"radtan": "plumb_bob", "radial-tangential": "plumb_bob", "plumb_bob": "plumb_bob",
          "equidistant": "equidistant", "fisheye": "equidistant", "kannala_brandt": "equidistant", "none": "plumb_bob"}
MIN_BASELINE = 1e-6  # m


def rectify(left, right, source):
    """(left, right) Camera of two RawCamera. InputError, naming `source`, unless the right one is to the right."""
    import cv2
    if left.model != right.model or left.size != right.size:
        raise InputError("%s: the cameras differ in model or size (%s, %s and %s, %s), allowed: two of a kind"
                         % (source, left.model, left.size, right.model, right.size))
    right_T_left = inverse(right.imu_T_cam) @ left.imu_T_cam
    if np.linalg.norm(right_T_left[:3, 3]) < MIN_BASELINE:
        raise InputError("%s: both cameras are in one place, allowed: the second one to the right of the first" % source)
    arguments = (left.intrinsics, left.distortion, right.intrinsics, right.distortion, tuple(left.size),
                 right_T_left[:3, :3], right_T_left[:3, 3])
    if left.model == "equidistant":
        matrices = cv2.fisheye.stereoRectify(*arguments, cv2.fisheye.CALIB_ZERO_DISPARITY)[:4]
        matrices = _with_focal_length(np.sqrt(left.intrinsics[0, 0] * left.intrinsics[1, 1]), left.size, *matrices)
    else:
        matrices = cv2.stereoRectify(*arguments, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0.0)[:4]
    left_R, right_R, left_P, right_P = (np.asarray(matrix) for matrix in matrices)
    checks.require_intrinsics(left_P[:, :3], "%s: P of the rectified pair" % source)
    if not right_P[0, 3] < 0.0 or abs(right_P[1, 3]) > 0.0:
        raise InputError("%s: the second camera is at (%g, %g, %g) m of the first, allowed: to its right"
                         % (source, *inverse(right_T_left)[:3, 3]))
    return tuple(Camera(camera.size, camera.intrinsics, camera.model, camera.distortion, R, P)
                 for camera, R, P in ((left, left_R, left_P), (right, right_R, right_P)))


def _with_focal_length(focal_length, size, left_R, right_R, left_P, right_P):
    """The same with another focal length (px), and the axis in the middle.

    OpenCV shrinks a fisheye's picture until a plane holds what is seen to its sides: to a focal length of 58 px at 77 deg, to 4 px
    at 90 deg. Points need no plane of that size, and what is said in pixels should mean those of the camera.
    """
    centre = 0.5 * (np.array(size) - 1.0)
    left_P, right_P = (np.array([[focal_length, 0, centre[0], focal_length / P[0, 0] * P[0, 3]],
                                 [0, focal_length, centre[1], focal_length / P[1, 1] * P[1, 3]], [0, 0, 1.0, 0]])
                       for P in (left_P, right_P))
    return left_R, right_R, left_P, right_P
