"""Pose files: KITTI odometry (12 numbers a row) and TUM (`stamp tx ty tz qx qy qz qw`)."""

import os

import numpy as np

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError, unreadable
from vi_ekf_slam.common.geometry import (make_transform, nearest_rotation, quaternion_to_rotation, rotation_error,
                                         rotation_to_quaternion)

KITTI_COLUMNS, TUM_COLUMNS = 12, 8
LONGEST_LINE = 1 << 16  # characters
ROTATION_TOLERANCE = 1e-3  # largest entry of |R^T R - I| and of | |q| - 1 |; KITTI's text keeps six digits


def read_pose_file(path):
    """Read either format, told apart by the number of columns.

    Returns (stamps, poses): stamps (N,) s for TUM or None for KITTI, poses (N, 4, 4). Empty lines and lines that begin
    with # are skipped. InputError names the file, the line, the value and what is allowed.
    """
    rows, lines = _read_rows(path)
    if rows.shape[1] == KITTI_COLUMNS:
        return None, _kitti_poses(path, rows, lines)
    checks.require_stamps(rows[:, 0], "%s: stamp" % path, lambda k: "in line %d" % lines[k])
    return rows[:, 0], quaternions_to_poses(rows[:, 4:], rows[:, 1:4], lambda k: "%s: line %d" % (path, lines[k]))


def read_tum(path):
    """Read a TUM file: (stamps (N,) s, poses (N, 4, 4))."""
    stamps, poses = read_pose_file(path)
    if stamps is None:
        raise InputError("%s: has %d columns, allowed: the %d of `stamp tx ty tz qx qy qz qw`"
                         % (path, KITTI_COLUMNS, TUM_COLUMNS))
    return stamps, poses


def tum_line(stamp, pose):
    """One line of a TUM file without its end. stamp: s, as text or number; pose: 3 x 4 or 4 x 4."""
    numbers = np.concatenate([pose[:3, 3], rotation_to_quaternion(pose[:3, :3])])
    return " ".join([stamp if isinstance(stamp, str) else "%.9f" % stamp] + ["%.12g" % n for n in numbers])


def kitti_line(pose):
    """One line of a KITTI file without its end: the upper 3 x 4 of a transform, row by row."""
    return " ".join("%.12g" % n for n in np.ravel(pose[:3]))


def quaternions_to_poses(quaternions, positions, place):
    """(N, 4) x y z w and (N, 3) -> poses (N, 4, 4). place(k): how an InputError names row k, whose norm is not 1."""
    norms = np.linalg.norm(quaternions, axis=1)
    bad = int(np.argmax(np.abs(norms - 1.0)))
    if abs(norms[bad] - 1.0) > ROTATION_TOLERANCE:
        raise InputError("%s has a quaternion of norm %.6g, allowed: 1 within %g" % (place(bad), norms[bad], ROTATION_TOLERANCE))
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = quaternion_to_rotation(quaternions), positions
    return poses


def _read_rows(path):
    if os.path.isdir(path):
        raise InputError("%s: is a directory, allowed: a pose file" % path)
    rows, lines = [], []
    try:
        with open(path, encoding="utf-8-sig") as stream:
            for number, line in enumerate(iter(lambda: stream.readline(LONGEST_LINE), ""), start=1):
                if len(line) == LONGEST_LINE:
                    raise InputError("%s: line %d is longer than %d characters, allowed: 12 (KITTI) or 8 (TUM) numbers"
                                     % (path, number, LONGEST_LINE))
                words = line.split()
                if not words or words[0].startswith("#"):
                    continue
                if "," in line:
                    raise InputError("%s: line %d has commas, allowed: 12 (KITTI) or 8 (TUM) numbers separated by spaces; "
                                     "EuRoC's data.csv is read with its recording, by dataset_to_bag.py" % (path, number))
                allowed = (len(rows[0]),) if rows else (KITTI_COLUMNS, TUM_COLUMNS)
                if len(words) not in allowed:
                    raise InputError("%s: line %d has %d columns, allowed: %s"
                                     % (path, number, len(words), " or ".join(map(str, allowed))))
                rows.append([_number(path, number, word) for word in words])
                lines.append(number)
    except UnicodeDecodeError:
        raise InputError("%s: is not a text file in UTF-8, allowed: 12 (KITTI) or 8 (TUM) numbers a line" % path)
    except OSError as reason:
        raise unreadable(path, reason)
    if not rows:
        raise InputError("%s: holds no pose, allowed: 12 (KITTI) or 8 (TUM) numbers a line" % path)
    return np.array(rows), lines


def _number(path, line, word):
    try:
        value = float(word)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputError("%s: line %d holds '%s', allowed: finite numbers" % (path, line, word))
    return value


def _kitti_poses(path, rows, lines):
    matrices = rows.reshape(-1, 3, 4)
    errors = rotation_error(matrices[:, :, :3])
    bad = int(np.argmax(errors))
    if errors[bad] > ROTATION_TOLERANCE:
        raise InputError("%s: line %d is not a pose: its 3 x 3 block is no rotation (determinant %.6g), allowed: "
                         "orthonormal within %g with determinant +1"
                         % (path, lines[bad], np.linalg.det(matrices[bad, :, :3]), ROTATION_TOLERANCE))
    return np.array([make_transform(nearest_rotation(m[:, :3]), m[:, 3]) for m in matrices])
