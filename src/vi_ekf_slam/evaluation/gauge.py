"""What of the world frame an estimate was free to choose, its gauge, and how truth is brought into that frame.

pose: all six degrees of freedom; the estimate begins at the identity. yaw: heading and position; gravity shows which way
is up. none: the estimate was given a state in the truth's own frame.
"""

import numpy as np

from vi_ekf_slam.common.geometry import inverse, make_transform, so3_exp, so3_log

GAUGES = ("pose", "yaw", "none")


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


def yaw_of(rotation):
    """The rotation about z (3, 3) that is nearest to a rotation (in the Frobenius norm)."""
    return so3_exp([0.0, 0.0, np.arctan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1])])


def yaw_alignment(source, target):
    """The transform target_T_source, a rotation about z and a translation, that minimises sum |target_T_source p_i - q_i|^2.

    source, target: (N, 3) points, N >= 1.
    """
    source, target = np.asarray(source, dtype=float), np.asarray(target, dtype=float)
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    rotation = yaw_of((target - target_mean).T @ (source - source_mean))
    return make_transform(rotation, target_mean - rotation @ source_mean)


def errors_after_yaw_alignment(estimate, truth):
    """(position RMSE m, orientation RMSE deg) of poses (N, 4, 4), row by row, after yaw_alignment of all positions."""
    estimate, truth = np.asarray(estimate, dtype=float), np.asarray(truth, dtype=float)
    aligned = yaw_alignment(estimate[:, :3, 3], truth[:, :3, 3]) @ estimate
    positions = aligned[:, :3, 3] - truth[:, :3, 3]
    angles = so3_log(np.swapaxes(truth[:, :3, :3], 1, 2) @ aligned[:, :3, :3])
    return tuple(float(np.sqrt(np.mean(np.sum(errors**2, axis=1)))) for errors in (positions, np.degrees(angles)))


def differences_of_up(estimate, truth):
    """(N,) rad, between the directions, in the body's axes, of what is upwards by poses (N, 4, 4) of both."""
    cosine = np.einsum("ni,ni->n", np.asarray(estimate)[:, 2, :3], np.asarray(truth)[:, 2, :3])
    return np.arccos(np.clip(cosine, -1.0, 1.0))
