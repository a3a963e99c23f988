"""The camera's pose on the IMU, and the misreading of it that some dataset files carry."""

import numpy as np

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse, make_transform, nearest_rotation, rotation_error

ROTATION_TOLERANCE = 1e-4  # largest entry of |R^T R - I|; files keep six to eight digits
READINGS = ("repaired", "given")


def check_transform(matrix, name):
    """A 4 x 4 rigid transform with its rotation made exact; InputError (naming `name`) when it is not rigid."""
    if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError("%s has the last row %s, allowed: 0 0 0 1" % (name, _row(matrix[3])))
    error = float(rotation_error(matrix[:3, :3]))
    if not error <= ROTATION_TOLERANCE:
        raise InputError(
            "%s is not a rotation in its upper left 3 x 3 block (determinant %.6g, largest entry of |R^T R - I| %.3g), "
            "allowed: determinant +1 and at most %g"
            % (name, np.linalg.det(matrix[:3, :3]), np.abs(matrix[:3, :3].T @ matrix[:3, :3] - np.eye(3)).max(),
               ROTATION_TOLERANCE)
        )
    return make_transform(nearest_rotation(matrix[:3, :3]), matrix[:3, 3])


def read_extrinsic(matrix, key, reading="repaired"):
    """The transform cam_T_imu that a file's matrix means.

    matrix: checked 4 x 4. key: "cam_T_imu" or "imu_T_cam". Files with the key cam_T_imu hold [R, t] where t is not the
    IMU's origin in camera axes, as the name says, but the camera's position in IMU axes: the true matrix is
    [R, -R t]. reading "repaired" reads them so; "given" takes the matrix at its word. imu_T_cam is always right.
    Returns (cam_T_imu, repaired), the second telling whether the repair was applied.
    """
    if key == "imu_T_cam":
        return inverse(matrix), False
    if reading == "given":
        return np.array(matrix), False
    rotation, camera_in_imu = matrix[:3, :3], matrix[:3, 3]
    return make_transform(rotation, -rotation @ camera_in_imu), True


def _row(values):
    return " ".join("%g" % v for v in values)
