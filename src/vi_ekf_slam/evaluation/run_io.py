"""Read the directory that run_bag writes: trajectories, covariances, frame reports, landmark map and summary."""

import os
from types import SimpleNamespace

import numpy as np

from vi_ekf_slam.common.csv_columns import read_columns
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.yaml_file import read_mapping
from vi_ekf_slam.dataset.pose_files import read_tum

LANDMARK_COLUMNS = ["id", "x", "y", "z", "xx", "xy", "xz", "yy", "yz", "zz"]
FRAME_COLUMNS = ("stamp", "features", "used", "rejected", "landmarks", "frame_rejected", "nis", "nis_dof")
FRAME_TIME = "update_ms"  # wall time in ms that the estimator took for the frame
CERTAIN = 0.01  # m, rad: an estimate begins with far less
AT_ONCE = 0.5  # s: frames come faster, and shorter gaps end no start
COVARIANCE_COLUMNS = ["xyzabc"[row] + "xyzabc"[column] for row in range(6) for column in range(row, 6)]


class Run(SimpleNamespace):
    """One run. Frames: world is the estimator's fixed frame, imu its body.

    summary: dict of summary.yaml, empty when there is none.
    stamps (N,) s, poses (N, 4, 4): world_T_imu, one per feature frame.
    dead_stamps (D,), dead_poses (D, 4, 4): the same by dead reckoning alone.
    smoothed: (stamps, poses), the trajectory as it is known at the end, where that is another one, else None.
    landmarks (L, 3) m, landmark_covariances (L, 3, 3) m^2, both in the world frame.
    """

    def horizontal_deviations(self):
        """Per landmark the standard deviation in m along the worst horizontal direction; nan for a bad covariance."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(np.linalg.eigvalsh(self.landmark_covariances[:, :2, :2])[:, 1])


def read_run(folder, dead_reckoning_folder=None):
    """Read a run directory; InputError names the file and what is wrong with it.

    dead_reckoning_folder: take dead_reckoning.tum from this run instead.
    """
    for directory in (folder, dead_reckoning_folder or folder):
        if not os.path.isdir(directory):
            raise InputError("%s: is not a directory, allowed: one that run_bag wrote" % directory)
    trajectory = read_tum(os.path.join(folder, "trajectory.tum"))
    dead_stamps, dead_poses = read_tum(os.path.join(dead_reckoning_folder or folder, "dead_reckoning.tum"))
    landmarks, landmark_covariances = read_landmarks(os.path.join(folder, "landmarks.csv"))
    return Run(
        stamps=trajectory[0], poses=trajectory[1], dead_stamps=dead_stamps, dead_poses=dead_poses, landmarks=landmarks,
        landmark_covariances=landmark_covariances, summary=read_summary(os.path.join(folder, "summary.yaml")),
        smoothed=_read_smoothed(os.path.join(folder, "trajectory_smoothed.tum"), trajectory))


def _read_smoothed(path, trajectory):
    """(stamps, poses), or None where there is no such file (runs of before) or it is the trajectory."""
    if not os.path.exists(path):
        return None
    smoothed = read_tum(path)
    return None if all(np.array_equal(a, b) for a, b in zip(smoothed, trajectory)) else smoothed


def read_landmarks(path):
    """landmarks.csv -> (positions (L, 3) m, covariances (L, 3, 3) m^2). L may be 0."""
    columns = read_columns(path, LANDMARK_COLUMNS, allow_empty=True, finite=True)
    table = np.column_stack([columns[name] for name in LANDMARK_COLUMNS[1:]])
    return table[:, :3], table[:, [3, 4, 5, 4, 6, 7, 5, 7, 8]].reshape(-1, 3, 3)


def read_summary(path):
    """summary.yaml -> dict; a run without one has an empty summary."""
    if not os.path.exists(path):
        return {}
    summary = read_mapping(path)
    if not isinstance(summary.get("body"), (str, type(None))):
        raise InputError("%s: body is %.80r, allowed: a name" % (path, summary["body"]))
    resets = summary.get("poses_before_resets")
    if not isinstance(resets, (list, type(None))):
        raise InputError("%s: poses_before_resets is %.80r, allowed: a list of numbers of poses" % (path, resets))
    return summary


def read_covariances(path, stamps):
    """covariance.csv -> (N, 6, 6), one for each of the trajectory's stamps (N,), or None when there is no such file.

    Order: x, y, z (m), rotations about the world's axes (rad).
    """
    if not os.path.exists(path):
        return None
    columns = read_columns(path, ["stamp"] + COVARIANCE_COLUMNS)
    if not np.array_equal(columns["stamp"], stamps):
        raise InputError("%s: its %d stamps are not the %d of the trajectory, allowed: a line for each pose"
                         % (path, len(columns["stamp"]), len(stamps)))
    result = np.empty((len(stamps), 6, 6))
    for name, row, column in zip(COVARIANCE_COLUMNS, *np.triu_indices(6)):
        result[:, row, column] = result[:, column, row] = columns[name]
    return result


def read_map_starts(folder, summary, stamps, covariances):
    """[(stamps, poses)] of earlier starts in whose map a run that was relocalised may be.

    Those are in folder/before_reset_N. A start is certain of its own frame, what was found in a map is not. The last poses of
    a start that goes on at once in a map were in a frame that is given up then, so it is left out.
    """
    if not summary.get("relocalisations") or _is_certain(covariances[0]):
        return []
    starts, following = [], (stamps[0], False)
    for number in range(len(summary.get("poses_before_resets") or []), 0, -1):
        earlier = os.path.join(folder, "before_reset_%d" % number)
        if not os.path.isdir(earlier):
            continue
        trajectory = read_tum(os.path.join(earlier, "trajectory.tum"))
        earlier_covariances = read_covariances(os.path.join(earlier, "covariance.csv"), trajectory[0])
        certain = earlier_covariances is not None and _is_certain(earlier_covariances[0])
        given_up = not following[1] and abs(following[0] - trajectory[0][-1]) < AT_ONCE
        if certain and not given_up:
            starts.append(trajectory)
        following = trajectory[0][0], certain
    return starts


def _is_certain(covariance):
    """Of position and heading."""
    return bool(np.all(np.diag(covariance)[[0, 1, 2, 5]] < CERTAIN**2))


def read_frames(path):
    """frames.csv -> {column: (F,) floats}; None when there is no such file or no frame in it.

    FRAME_TIME is among the columns only where the file has it.
    """
    if not os.path.exists(path):
        return None
    columns = read_columns(path, FRAME_COLUMNS, optional=[FRAME_TIME], allow_empty=True)
    return columns if len(columns["stamp"]) else None
