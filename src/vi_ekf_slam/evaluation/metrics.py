"""Trajectory errors: absolute trajectory error, relative pose error and the KITTI odometry benchmark's errors."""

from collections import namedtuple

import numpy as np

from vi_ekf_slam.common.geometry import inverse, make_transform, nearest_rotation

KITTI_LENGTHS = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)  # m
KITTI_STEP = 10  # frames between the starts of sub-sequences

KittiErrors = namedtuple("KittiErrors", "t_rel r_rel count")
KittiErrors.__doc__ = """t_rel in %, r_rel in deg per 100 m, averaged over `count` sub-sequences (nan when there are none)."""

RelativeErrors = namedtuple("RelativeErrors", "translation rotation count")
RelativeErrors.__doc__ = """RMS over `count` pairs of poses: translation in m, rotation in deg (nan when there are none)."""
NO_RELATIVE_ERRORS = RelativeErrors(float("nan"), float("nan"), 0)


def rigid_alignment(source, target, nearest=nearest_rotation):
    """The transform target_T_source, without scale, that minimises sum |target_T_source p_i - q_i|^2.

    source, target: (N, 3) points, N >= 1. Umeyama, IEEE PAMI 13(4), 1991; the determinant is kept at +1, so that a
    planar or noisy cloud is never mirrored. nearest: of the rotations that are allowed the one next to a matrix (3, 3).
    """
    source, target = _same_length(source, target, (3,))
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    rotation = nearest((target - target_mean).T @ (source - source_mean))
    return make_transform(rotation, target_mean - rotation @ source_mean)


def absolute_trajectory_error(estimate, truth):
    """Position RMSE in m after rigid alignment. estimate, truth: (N, 4, 4) poses or (N, 3) positions, row by row."""
    estimate, truth = _positions(estimate), _positions(truth)
    truth_T_estimate = rigid_alignment(estimate, truth)
    residual = estimate @ truth_T_estimate[:3, :3].T + truth_T_estimate[:3, 3] - truth
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


def anchored_errors(estimate, truth):
    """Position errors (N,) in m when the first poses are laid onto each other, rotation and all.

    estimate, truth: (N, 4, 4) poses of the same body, row by row; their world frames need not agree.
    """
    estimate, truth = _same_length(estimate, truth, (4, 4))
    return np.linalg.norm((inverse(estimate[0]) @ estimate - inverse(truth[0]) @ truth)[:, :3, 3], axis=1)


def distances(positions, sections=None):
    """Distance (N,) in m along (N, 3) positions or (N, 4, 4) poses up to each of them.

    sections (N,): a number for each stretch between gaps, None: one stretch. The way across a gap is not known and left out.
    """
    steps = np.linalg.norm(np.diff(_positions(positions), axis=0), axis=1)
    if sections is not None:
        steps = np.where(np.diff(sections) == 0, steps, 0.0)
    return np.concatenate([[0.0], np.cumsum(steps)])


def pairs_ahead(values, delta, sections=None):
    """Index pairs (first, last), each an array: last is the first row whose value is `delta` or more above first's.

    values: (N,) increasing, stamps in s or distances in m. Rows with nothing that far ahead have no pair. What is short
    of delta by less than its millionth part counts: stamps are rounded. sections: of distances; no pair spans a gap.
    """
    last = np.searchsorted(values, np.asarray(values) + delta * (1.0 - 1e-6), side="left")
    first = np.flatnonzero(last < len(values))
    if sections is not None:
        first = first[sections[first] == sections[last[first]]]
    return first, last[first]


def relative_pose_errors(estimate, truth, pairs):
    """RelativeErrors over pairs (first, last) of rows.

    estimate, truth: (N, 4, 4) poses of the same body, row by row. The error of a pair is inv(inv(Q_i) Q_j) inv(P_i) P_j
    with truth Q and estimate P (Sturm et al., IROS 2012), which world frames do not enter.
    """
    errors = _relative_errors(*_same_length(estimate, truth, (4, 4)), *pairs)
    if len(errors) == 0:
        return NO_RELATIVE_ERRORS
    translation, rotation = np.sqrt(np.mean(errors**2, axis=0))
    return RelativeErrors(float(translation), float(np.degrees(rotation)), len(errors))


def kitti_segments(estimate, truth, lengths=KITTI_LENGTHS, step=KITTI_STEP, sections=None):
    """Errors of sub-sequences of given lengths (m along the truth), one starting at every step-th frame.

    estimate, truth: (N, 4, 4) poses of the same body, row by row; their world frames need not agree.
    As in the development kit of the KITTI odometry benchmark (Geiger et al., CVPR 2012): a sub-sequence ends at the
    first frame MORE than its length away, and its error is divided by the nominal length. sections: of distances; none
    spans a gap.
    Returns (S, 3): nominal length in m, translation error per m, rotation error in rad per m.
    """
    estimate, truth = _same_length(estimate, truth, (4, 4))
    distance = distances(truth, sections)
    chosen = []
    for first in range(0, len(truth), step):
        for length in lengths:
            last = int(np.searchsorted(distance, distance[first] + length, side="right"))
            if last == len(truth) or (sections is not None and sections[first] != sections[last]):
                break  # longer ones do not fit either
            chosen.append((first, last, length))
    first, last, length = np.array(chosen).reshape(-1, 3).T
    errors = _relative_errors(estimate, truth, first.astype(int), last.astype(int))
    return np.column_stack([length, errors / length[:, None]])


def mean_kitti_errors(segments):
    """KittiErrors of the rows of kitti_segments."""
    if len(segments) == 0:
        return KittiErrors(float("nan"), float("nan"), 0)
    _, t_rel, r_rel = np.mean(segments, axis=0)
    return KittiErrors(100.0 * t_rel, 100.0 * np.degrees(r_rel), len(segments))


def left_camera_poses(world_T_imu, cam_T_imu):
    """World_T_imu (N, 4, 4) -> poses of the left camera in its own first frame, as in KITTI's pose files.

    Row k is inv(world_T_cam_0) world_T_cam_k with world_T_cam_k = world_T_imu_k inv(cam_T_imu).
    """
    world_T_cam = np.asarray(world_T_imu, dtype=float) @ inverse(cam_T_imu)
    return inverse(world_T_cam[0]) @ world_T_cam


def _relative_errors(estimate, truth, first, last):
    """(len(first), 2): translation in m and rotation in rad by which the estimate's motion differs from the truth's."""
    error = inverse(inverse(estimate[first]) @ estimate[last]) @ (inverse(truth[first]) @ truth[last])
    cosine = np.clip(0.5 * (np.trace(error[:, :3, :3], axis1=1, axis2=2) - 1.0), -1.0, 1.0)
    return np.column_stack([np.linalg.norm(error[:, :3, 3], axis=1), np.arccos(cosine)])


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
