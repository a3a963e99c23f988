"""Trajectory errors: absolute trajectory error and the KITTI odometry benchmark's sub-sequence errors."""

from collections import namedtuple

import numpy as np

from vi_ekf_slam.geometry import inverse, make_transform

KITTI_LENGTHS = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)  # m
KITTI_STEP = 10  # frames between the starts of sub-sequences

KittiErrors = namedtuple("KittiErrors", "t_rel r_rel count")
KittiErrors.__doc__ = """t_rel in %, r_rel in deg per 100 m, averaged over `count` sub-sequences (nan when there are none)."""


def rigid_alignment(source, target):
    """The transform target_T_source, without scale, that minimises sum |target_T_source p_i - q_i|^2.

    source, target: (N, 3) points, N >= 1. Umeyama, IEEE PAMI 13(4), 1991; the determinant is kept at +1, so that a
    planar or noisy cloud is never mirrored.
    """
    source, target = _same_length(source, target, (3,))
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((target - target_mean).T @ (source - source_mean))
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return make_transform(rotation, target_mean - rotation @ source_mean)


def absolute_trajectory_error(estimate, truth):
    """Position RMSE in m after rigid alignment. estimate, truth: (N, 4, 4) poses or (N, 3) positions, row by row."""
    estimate, truth = _positions(estimate), _positions(truth)
    truth_T_estimate = rigid_alignment(estimate, truth)
    residual = estimate @ truth_T_estimate[:3, :3].T + truth_T_estimate[:3, 3] - truth
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


def kitti_errors(estimate, truth, lengths=KITTI_LENGTHS, step=KITTI_STEP):
    """Errors over sub-sequences of given lengths (m along the truth), one starting at every step-th frame.

    estimate, truth: (N, 4, 4) poses of the same body, row by row; their world frames need not agree.
    As in the development kit of the KITTI odometry benchmark (Geiger et al., CVPR 2012): a sub-sequence ends at the
    first frame MORE than its length away, and its error is divided by the nominal length.
    """
    estimate, truth = _same_length(estimate, truth, (4, 4))
    distance = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))])
    errors = []
    for first in range(0, len(truth), step):
        for length in lengths:
            last = int(np.searchsorted(distance, distance[first] + length, side="right"))
            if last == len(truth):
                break  # longer ones do not fit either
            error = inverse(inverse(estimate[first]) @ estimate[last]) @ (inverse(truth[first]) @ truth[last])
            cosine = np.clip(0.5 * (np.trace(error[:3, :3]) - 1.0), -1.0, 1.0)
            errors.append((np.linalg.norm(error[:3, 3]) / length, np.arccos(cosine) / length))
    if not errors:
        return KittiErrors(float("nan"), float("nan"), 0)
    t_rel, r_rel = np.mean(errors, axis=0)
    return KittiErrors(100.0 * t_rel, 100.0 * np.degrees(r_rel), len(errors))


def left_camera_poses(world_T_imu, cam_T_imu):
    """World_T_imu (N, 4, 4) -> poses of the left camera in its own first frame, as in KITTI's pose files.

    Row k is inv(world_T_cam_0) world_T_cam_k with world_T_cam_k = world_T_imu_k inv(cam_T_imu).
    """
    world_T_cam = np.asarray(world_T_imu, dtype=float) @ inverse(cam_T_imu)
    return inverse(world_T_cam[0]) @ world_T_cam


def _positions(trajectory):
    trajectory = np.asarray(trajectory, dtype=float)
    return trajectory[:, :3, 3] if trajectory.ndim == 3 else trajectory


def _same_length(first, second, row_shape):
    first, second = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if first.shape != second.shape or first.shape[1:] != row_shape or len(first) == 0:
        raise ValueError(
            "two arrays of one shape (N, %s) with N > 0 expected, got %s and %s"
            % (", ".join(map(str, row_shape)), first.shape, second.shape)
        )
    return first, second
