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
    result = np.full(len(errors), np.nan)
    for k, (error, covariance) in enumerate(zip(errors, covariances)):
        variances = np.diag(covariance)
        if not (np.all(np.isfinite(covariance)) and np.all(variances > 0.0)):
            continue
        scale = 1.0 / np.sqrt(variances)
        try:
            lower = np.linalg.cholesky(scale[:, None] * covariance * scale)
        except np.linalg.LinAlgError:
            continue
        result[k] = np.sum(np.linalg.solve(lower, scale * error) ** 2)
    return result


def chi_square_bounds(dof, outside=0.05):
    """Lower and upper bounds of a chi-square variable, beyond which it lies but for the share `outside`, as often below as
    above. dof: number or array; nan for 0."""
    return chdtri(dof, 1.0 - outside / 2.0), chdtri(dof, outside / 2.0)
