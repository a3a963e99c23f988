"""Does the covariance say how large the error is? Pose errors, their NEES and its chi-square bounds."""

import numpy as np
from scipy.special import chdtri

from vi_ekf_slam.common.geometry import so3_log

POSE_AXES = ("x", "y", "z", "roll", "pitch", "yaw")  # order of covariance.csv; rotations are about the world's axes


def pose_errors(poses, truth):
    """Errors (N, 6) of poses against the truth, both (N, 4, 4) in ONE world frame: m, then rad about the world's axes.

    These are the coordinates of covariance.csv and of geometry_msgs/PoseWithCovariance: with the estimate (R^, p^) and
    the truth (R, p) the error is (p^ - p, Log(R^ R^T)).
    """
    poses, truth = np.asarray(poses, dtype=float), np.asarray(truth, dtype=float)
    rotations = poses[:, :3, :3] @ np.swapaxes(truth[:, :3, :3], 1, 2)
    return np.column_stack([poses[:, :3, 3] - truth[:, :3, 3], so3_log(rotations)])


def nees(errors, covariances):
    """Normalised estimation error squared e^T P^-1 e of each row; nan where P is not positive definite.

    errors (N, n), covariances (N, n, n). The rows are scaled to a unit diagonal first: m^2 and rad^2 differ by orders
    of magnitude.
    """
    errors, covariances = np.asarray(errors, dtype=float), np.asarray(covariances, dtype=float)
    result = np.full(len(errors), np.nan)
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    rows = np.flatnonzero(np.isfinite(covariances).all(axis=(1, 2)) & (variances > 0.0).all(axis=1))
    scales = 1.0 / np.sqrt(variances[rows])
    scaled = scales[:, :, None] * covariances[rows] * scales[:, None, :]
    try:
        lower = np.linalg.cholesky(scaled)
    except np.linalg.LinAlgError:
        definite = np.array([_is_positive_definite(matrix) for matrix in scaled])
        rows, scales, lower = rows[definite], scales[definite], np.linalg.cholesky(scaled[definite])
    result[rows] = np.sum(np.linalg.solve(lower, (scales * errors[rows])[:, :, None])[:, :, 0] ** 2, axis=1)
    return result


def _is_positive_definite(matrix):
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def chi_square_bounds(dof, outside=0.05):
    """Lower and upper bounds of a chi-square variable, beyond which it lies but for the share `outside`, as often below as
    above. dof: number or array; nan for 0."""
    return chdtri(dof, 1.0 - outside / 2.0), chdtri(dof, outside / 2.0)
