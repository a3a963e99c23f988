"""The text files of KITTI: calibration (`key: numbers`), stamps, and the rows of oxts."""

import datetime
import os

import numpy as np

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import make_transform, nearest_rotation, rotation_error
from vi_ekf_slam.common.yaml_file import read_text
from vi_ekf_slam.dataset.pose_files import ROTATION_TOLERANCE
from vi_ekf_slam.recordings.recording import increasing_rows

OXTS_COLUMNS = 30
NO_STAMP = 0  # ns, of rows that are left out; ROS takes a stamp of zero for none
EPOCH = datetime.datetime(1970, 1, 1)


def read_lines(path):
    """Lines of a text file without those that are empty."""
    lines = [line.strip() for line in read_text(path, "ascii").split("\n") if line.strip()]
    if not lines:
        raise InputError("%s: is empty" % path)
    return lines


class Calibration:
    """A file of `key: numbers` lines."""

    def __init__(self, path):
        self.path = path
        self._lines = dict((line.partition(":")[0].strip(), line.partition(":")[2]) for line in read_lines(path))

    def matrix(self, key, *shape):
        """The numbers under `key`, finite and of this shape."""
        if key not in self._lines:
            raise InputError("%s: key '%s' is missing" % (self.path, key))
        try:
            values = np.array([float(word) for word in self._lines[key].split()]).reshape(shape)
        except ValueError:
            raise InputError("%s: %s is '%s', allowed: %d numbers" % (self.path, key, self._lines[key], np.prod(shape)))
        checks.require_finite(values, "%s: %s" % (self.path, key))
        return values

    def rotation(self, key):
        """3 x 3, made exact."""
        matrix = self.matrix(key, 3, 3)
        if not rotation_error(matrix) <= ROTATION_TOLERANCE:
            raise InputError("%s: %s is no rotation" % (self.path, key))
        return nearest_rotation(matrix)

    def transform(self):
        """4 x 4 of the keys R and T."""
        return make_transform(self.rotation("R"), self.matrix("T", 3))

    def rectified(self, left_key, right_key):
        """(intrinsics 3 x 3, position of the left camera along x in m, baseline m) of two projections 3 x 4."""
        left, right = self.matrix(left_key, 3, 4), self.matrix(right_key, 3, 4)
        intrinsics = left[:, :3]
        checks.require_intrinsics(intrinsics, "%s: %s" % (self.path, left_key))
        baseline = checks.require_positive((left[0, 3] - right[0, 3]) / intrinsics[0, 0],
                                           "%s: baseline of %s and %s" % (self.path, left_key, right_key), "m")
        return intrinsics, -left[0, 3] / intrinsics[0, 0], baseline


def read_timestamps(path, faults):
    """(N,) ns since 1970 of lines like 2011-09-26 13:02:25.967790592, taken as UTC; see only_increasing."""
    stamps = []
    for number, line in enumerate(read_lines(path), start=1):
        whole, _, fraction = line.partition(".")
        try:
            seconds = int((datetime.datetime.strptime(whole, "%Y-%m-%d %H:%M:%S") - EPOCH).total_seconds())
            stamps.append(seconds * 10**9 + int(fraction[:9].ljust(9, "0") or 0))
        except ValueError:
            raise InputError("%s: line %d is '%s', allowed: like 2011-09-26 13:02:25.967790592" % (path, number, line[:60]))
    return only_increasing(np.array(stamps, dtype=np.int64), path, faults)


def only_increasing(stamps, name, faults):
    """(N,) ns with NO_STAMP where one does not increase, which is added to `faults`: rows keep the numbers of their files."""
    return np.where(increasing_rows(stamps, name, faults), stamps, NO_STAMP)


def read_oxts(folder, faults):
    """(stamps (N,) ns, rows (N, 30)) of an oxts folder: what dataformat.txt explains. Faults are added to `faults`."""
    all_stamps = read_timestamps(os.path.join(folder, "timestamps.txt"), faults)
    data = os.path.join(folder, "data")
    names = set(os.listdir(data)) if os.path.isdir(data) else set()
    stamps, rows = [], []
    for k, stamp in enumerate(all_stamps):
        path = os.path.join(data, "%010d.txt" % k)
        names.discard(os.path.basename(path))
        if stamp == NO_STAMP:
            continue
        try:
            row = [float(word) for word in read_lines(path)[0].split()]
            if len(row) != OXTS_COLUMNS or not np.all(np.isfinite(row)):
                raise ValueError("%d columns" % len(row))
        except (InputError, ValueError) as reason:
            text = str(reason) if isinstance(reason, InputError) else "%s: is damaged: %s, allowed: %d finite numbers" % (
                path, reason, OXTS_COLUMNS)
            faults.add(text)
            continue
        stamps.append(stamp)
        rows.append(row)
    for name in sorted(names):
        faults.add("%s: is not in timestamps.txt" % os.path.join(data, name))
    if len(rows) < 2:
        faults.notes()
        raise InputError("%s: holds %d rows, allowed: two or more" % (folder, len(rows)))
    return np.array(stamps, dtype=np.int64), np.array(rows)
