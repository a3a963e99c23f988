"""What of the world frame an estimate was free to choose, its gauge, and how truth is brought into that frame.

pose: all six degrees of freedom; the estimate begins at the identity. yaw: heading and position; gravity shows which way
is up. none: the estimate was given a state in the truth's own frame.
"""

import numpy as np

from vi_ekf_slam.common.geometry import hat, inverse, make_transform, so3_exp, so3_log
from vi_ekf_slam.evaluation.metrics import rigid_alignment

# What is free, of the coordinates of covariance.csv: x, y, z, and rotations about the world's axes.
FREE = {"pose": [0, 1, 2, 3, 4, 5], "yaw": [0, 1, 2, 5], "none": []}
GAUGES = tuple(FREE)


def gauge_of(summary):
    """The gauge of a run by its summary.yaml (dict), whose `motion` says whether it used gravity or was given a state."""
    motion = str(summary.get("motion"))
    if summary.get("start") == "given" or "initial state" in motion:
        return "none"
    return "yaw" if motion.startswith(("inertial", "motion: inertial")) else "pose"


def frame_change(estimate, truth, gauge):
    """estimate_T_truth: from the truth's world frame to the estimate's, by one pose (4 x 4) that both have."""
    if gauge == "none":
        return np.eye(4)
    if gauge == "pose":
        return estimate @ inverse(truth)
    rotation = yaw_of(estimate[:3, :3] @ truth[:3, :3].T)
    return make_transform(rotation, estimate[:3, 3] - rotation @ truth[:3, 3])


def most_certain(covariances, gauge):
    """Row of the covariances (N, 6, 6) with the least determinant of what is free, of several the first."""
    free = FREE[gauge]
    signs, logs = np.linalg.slogdet(covariances[:, free][:, :, free])
    return int(np.argmin(np.where(signs >= 0.0, logs, np.inf)))


def covariances_of_frame(covariance, pose, poses, gauge):
    """What a covariance (6, 6) of `pose` says of poses (N, 4, 4) in a frame that frame_change lays onto it: (N, 6, 6).

    With the error e of the pose, of which S keeps what is free, the frame is wrong by A S e at a pose that is d away:
    A = [I, -[d]x; 0, I]. Its covariance there is A S P S A^T.
    """
    is_free = np.isin(np.arange(6), FREE[gauge])
    transport = np.tile(np.eye(6), (len(poses), 1, 1))
    transport[:, :3, 3:] = [-hat(offset) for offset in poses[:, :3, 3] - pose[:3, 3]]
    return transport @ (covariance * np.outer(is_free, is_free)) @ np.swapaxes(transport, 1, 2)


def yaw_of(rotation):
    """The rotation about z (3, 3) that is nearest to a rotation (in the Frobenius norm)."""
    return so3_exp([0.0, 0.0, np.arctan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1])])


def errors_after_yaw_alignment(estimate, truth):
    """(position RMSE m, orientation RMSE deg) of poses (N, 4, 4), row by row, after alignment of all positions by yaw and position."""
    estimate, truth = np.asarray(estimate, dtype=float), np.asarray(truth, dtype=float)
    aligned = rigid_alignment(estimate[:, :3, 3], truth[:, :3, 3], yaw_of) @ estimate
    positions = aligned[:, :3, 3] - truth[:, :3, 3]
    angles = so3_log(np.swapaxes(truth[:, :3, :3], 1, 2) @ aligned[:, :3, :3])
    return tuple(float(np.sqrt(np.mean(np.sum(errors**2, axis=1)))) for errors in (positions, np.degrees(angles)))


def differences_of_up(estimate, truth):
    """(N,) rad, between the directions, in the body's axes, of what is upwards by poses (N, 4, 4) of both."""
    cosine = np.einsum("ni,ni->n", np.asarray(estimate)[:, 2, :3], np.asarray(truth)[:, 2, :3])
    return np.arccos(np.clip(cosine, -1.0, 1.0))
