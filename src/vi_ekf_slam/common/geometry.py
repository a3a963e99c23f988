"""Rotations and rigid transforms as numpy arrays.

A transform `a_T_b` is 4 x 4 and takes homogeneous points from frame b to frame a. Twists are (v, w): m/s and rad/s, in
this order. Quaternions are (x, y, z, w), as in geometry_msgs. Functions accept leading batch dimensions where noted.
Logarithm: Barfoot, State Estimation for Robotics (2017), eq. 7.95.
"""

import numpy as np
from scipy.spatial.transform import Rotation

# Axes of a body (x forward, y left, z up) from those of a camera on it that looks ahead (x right, y down, z forward).
BODY_R_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def hat(w):
    """3-vector -> 3 x 3 matrix with hat(w) x = w x x (cross product)."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def so3_exp(phi):
    """Rotation vectors (..., 3, rad) -> rotation matrices."""
    return _to_matrix(Rotation.from_rotvec(phi))


def so3_log(rotation):
    """Rotation matrices (..., 3, 3) -> rotation vectors (..., 3, rad), of norm at most pi."""
    return _from_matrix(rotation).as_rotvec()


def se3_log(transform):
    """The twist times time (v dt, w dt), shape 6, that makes a transform: eq. 7.95 solved for the translation."""
    phi = so3_log(transform[:3, :3])
    angle = np.linalg.norm(phi)
    cross = hat(phi)
    factor = 1.0 / 12.0 if angle < 1e-4 else 1.0 / angle**2 - 0.5 / (angle * np.tan(0.5 * angle))
    return np.concatenate([(np.eye(3) - 0.5 * cross + factor * cross @ cross) @ transform[:3, 3], phi])


def make_transform(rotation, translation):
    """3 x 3 rotation and 3-vector -> 4 x 4 transform."""
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = translation
    return transform


def inverse(transform):
    """Inverse of rigid transforms, shape (..., 4, 4)."""
    transform = np.asarray(transform, dtype=float)
    result = np.zeros_like(transform)
    rotation_t = np.swapaxes(transform[..., :3, :3], -1, -2)
    result[..., :3, :3] = rotation_t
    result[..., :3, 3] = -(rotation_t @ transform[..., :3, 3, None])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def rotation_error(rotation):
    """How far matrices (..., 3, 3) are from rotations: largest |R^T R - I|, or infinity when det(R) <= 0."""
    rotation = np.asarray(rotation, dtype=float)
    gram = np.swapaxes(rotation, -1, -2) @ rotation
    error = np.abs(gram - np.eye(3)).max(axis=(-1, -2))
    return np.where(np.linalg.det(rotation) > 0.0, error, np.inf)


def nearest_rotation(matrix):
    """The rotation closest to a 3 x 3 matrix in the Frobenius norm (takes away the rounding of text files)."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt


def quaternion_to_rotation(quaternion):
    """Quaternion (x, y, z, w), not zero; normalised here -> rotation matrix."""
    return _to_matrix(Rotation.from_quat(quaternion))


def rotation_to_quaternion(rotation):
    """Rotation matrix -> unit quaternion (x, y, z, w) with w >= 0."""
    quaternion = _from_matrix(rotation).as_quat()
    return -quaternion if quaternion[3] < 0.0 else quaternion


def _to_matrix(rotation):
    return rotation.as_matrix() if hasattr(rotation, "as_matrix") else rotation.as_dcm()  # before SciPy 1.4 (Noetic)


def _from_matrix(matrix):
    return (Rotation.from_matrix if hasattr(Rotation, "from_matrix") else Rotation.from_dcm)(matrix)
