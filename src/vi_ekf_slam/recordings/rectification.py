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
# deg, of one picture against the other: a drawn room with 15 keeps its stereo matches, with 20 half of them, with 25 a tenth.
MAX_ROLL = 20.0


def rectify(left, right, source):
    """(left, right) Camera of two RawCamera. InputError, naming `source`, unless the right one is to the right, above or below.

    Of cameras one above the other the rectified pair is turned by 90 deg, so that the right one is to the right there.
    """
    import cv2
    if left.model != right.model or left.size != right.size:
        raise InputError("%s: the cameras differ in model or size (%s, %s and %s, %s), allowed: two of a kind"
                         % (source, left.model, left.size, right.model, right.size))
    right_T_left = inverse(right.imu_T_cam) @ left.imu_T_cam
    if np.linalg.norm(right_T_left[:3, 3]) < MIN_BASELINE:
        raise InputError("%s: both cameras are in one place, allowed: the second one to the right of the first" % source)
    roll = np.degrees(np.arctan2(right_T_left[1, 0] - right_T_left[0, 1], right_T_left[0, 0] + right_T_left[1, 1]))
    if abs(roll) > MAX_ROLL:
        raise InputError("%s: the pictures of the cameras are turned by %.0f deg against each other, allowed: %g; turn those of one "
                         "and calibrate again" % (source, abs(roll), MAX_ROLL))
    right_position = inverse(right_T_left)[:3, 3]
    turn, sizes, intrinsics = _side_by_side(right_position, left.size, (left.intrinsics, right.intrinsics))
    # The tangential part of D would turn too: all that it is asked for here is which focal length P should have.
    arguments = (intrinsics[0], left.distortion, intrinsics[1], right.distortion, sizes,
                 turn @ right_T_left[:3, :3] @ turn.T, turn @ right_T_left[:3, 3])
    if left.model == "equidistant":
        matrices = cv2.fisheye.stereoRectify(*arguments, cv2.fisheye.CALIB_ZERO_DISPARITY)[:4]
        matrices = _with_focal_length(np.sqrt(left.intrinsics[0, 0] * left.intrinsics[1, 1]), sizes, *matrices)
    else:
        matrices = cv2.stereoRectify(*arguments, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0.0)[:4]
    left_R, right_R, left_P, right_P = (np.asarray(matrix) for matrix in matrices)
    checks.require_intrinsics(left_P[:, :3], "%s: P of the rectified pair" % source)
    if not right_P[0, 3] < 0.0 or abs(right_P[1, 3]) > 0.0:
        raise InputError("%s: the second camera is at (%.3g, %.3g, %.3g) m of the first (x to the right in its picture), allowed: to "
                         "its right, above or below it; exchange the two" % (source, *right_position))
    return tuple(Camera(camera.size, camera.intrinsics, camera.model, camera.distortion, R @ turn, P)
                 for camera, R, P in ((left, left_R, left_P), (right, right_R, right_P)))


def side_by_side(left, right):
    """(left, right) Camera of a pair that is rectified, turned by 90 deg where the right one is above or below the left one."""
    matrices = [camera.projection[:, :3] for camera in (left, right)]
    shifts = [np.linalg.solve(K, camera.projection[:, 3]) for K, camera in zip(matrices, (left, right))]
    turn, _, turned = _side_by_side(-shifts[1], left.size, matrices)
    return tuple(camera._replace(rectification=turn @ camera.rectification, projection=np.column_stack([K, K @ turn @ shift]))
                 for camera, K, shift in zip((left, right), turned, shifts))


def _side_by_side(right_position, size, intrinsics):
    """(turn (3, 3), size, intrinsics): from the cameras' axes to those in which the right one is not above or below, and pictures there."""
    x, y, _ = right_position
    if abs(y) <= abs(x):
        return np.eye(3), tuple(size), intrinsics
    turn = np.sign(y) * np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, np.sign(y)]])
    width, height = size
    pixels = turn.copy()
    pixels[:2, 2] = (0.0, width - 1.0) if y > 0.0 else (height - 1.0, 0.0)
    return turn, (height, width), [pixels @ K @ turn.T for K in intrinsics]


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
