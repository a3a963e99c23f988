"""A drive as the course's .npz files hold it: load it, check everything, and read its two editions alike.

| key | shape | meaning |
| --- | --- | --- |
| time_stamps | 1 x T or T | s |
| linear_velocity | 3 x T | m/s, IMU axes (x forward, y left, z up) |
| rotational_velocity or angular_velocity | 3 x T | rad/s, IMU axes |
| features | 4 x M x T | uL vL uR vR in px of landmark m at frame t, all four -1 when unseen; some files have none |
| K | 3 x 3 | intrinsics of the rectified pair, px |
| b | scalar | baseline, m |
| cam_T_imu or imu_T_cam | 4 x 4 | see extrinsic.py |
"""

import os
from types import SimpleNamespace

import numpy as np

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.dataset.extrinsic import check_transform, read_extrinsic
from vi_ekf_slam.dataset.npz_reader import NpzReader

DEFAULT_MAX_MEMORY_MB = 4096.0
# As in the core (slam_system.hpp, rig_assembler.cpp): what is beyond is dropped there.
MAX_SPEED = {"linear_velocity": (1e3, "m/s"), "rotational_velocity": (1e3, "rad/s"), "angular_velocity": (1e3, "rad/s")}
MAX_LEVER_ARM = 1e4  # m
MAX_BASELINE = 1e3  # m
MAX_PIXEL = 1e5  # px, beyond any camera; keeps the image size in range
GYRO_KEYS = ("rotational_velocity", "angular_velocity")
EXTRINSIC_KEYS = ("cam_T_imu", "imu_T_cam")


class Dataset(SimpleNamespace):
    """A checked drive. Attributes that features alone need are None when the features were left out.

    name: file name without folder and suffix.
    stamps: (T,) s.                    linear_velocity, angular_velocity: (3, T).
    features: (4, M, T) px or None.    seen: (M, T) bool or None; False also where an observation was rejected.
    partial: number of rejected observations, those with some but not all four pixels at -1.
    intrinsics: 3 x 3 px or None.      baseline: m or None.
    cam_T_imu: 4 x 4 or None, as read. extrinsic_key, extrinsic_repaired: where it came from, and how it was read.
    """

    @property
    def frames(self):
        """Number of frames T."""
        return len(self.stamps)

    @property
    def duration(self):
        """Time in s from the first to the last frame."""
        return float(self.stamps[-1] - self.stamps[0])


def load_dataset(path, extrinsic="repaired", without_features=False, max_memory_mb=DEFAULT_MAX_MEMORY_MB):
    """Read and check `path`; InputError names the file, the key, the value and what is allowed.

    extrinsic: "repaired" or "given", see extrinsic.read_extrinsic. without_features: leave the features and the
    cameras out, also where the file has them.
    """
    with NpzReader(path, max_memory_mb) as reader:
        keys = reader.keys()
        gyro_key = _one_of(path, keys, GYRO_KEYS)
        stamps = _stamps(path, reader.read("time_stamps"))
        fields = {
            "name": os.path.splitext(os.path.basename(path))[0],
            "stamps": stamps,
            "linear_velocity": _twist_rows(path, "linear_velocity", reader, len(stamps)),
            "angular_velocity": _twist_rows(path, gyro_key, reader, len(stamps)),
            "features": None, "seen": None, "partial": 0, "intrinsics": None, "baseline": None,
        }
        fields.update(_extrinsic(path, keys, reader, extrinsic, required=not without_features))
        if not without_features:
            if "features" not in keys:
                raise InputError("%s: key 'features' is missing: without stereo features only dead reckoning is "
                                 "possible; --without-features converts the IMU and velocity alone" % path)
            fields["intrinsics"] = reader.read("K")
            checks.require_intrinsics(fields["intrinsics"], "%s: K" % path)
            fields["baseline"] = _baseline(path, reader.read("b"))
            fields.update(_features(path, reader.read("features"), len(stamps)))
    return Dataset(**fields)


def _one_of(path, keys, names):
    present = [name for name in names if name in keys]
    if len(present) != 1:
        raise InputError("%s: holds %s, allowed: exactly one of the keys '%s' and '%s'; the file holds: %s"
                         % (path, "both" if present else "neither", *names, ", ".join(keys) or "nothing"))
    return present[0]


def _stamps(path, stamps):
    name = "%s: time_stamps" % path
    if stamps.ndim == 2 and stamps.shape[0] == 1:
        stamps = stamps[0]
    if stamps.ndim != 1 or len(stamps) < 2:
        raise InputError("%s has shape %s, allowed: 1 x T or T with T at least 2" % (name, stamps.shape))
    checks.require_stamps(stamps, name)
    return stamps


def _twist_rows(path, key, reader, frames):
    rows = reader.read(key)
    name = "%s: %s" % (path, key)
    checks.require_shape(rows, (3, frames), name + " (one column a time stamp)")
    checks.require_finite(rows, name)
    checks.require_within(rows, MAX_SPEED[key][0], name, MAX_SPEED[key][1])
    return rows


def _extrinsic(path, keys, reader, reading, required):
    if not required and not any(key in keys for key in EXTRINSIC_KEYS):
        return {"cam_T_imu": None, "extrinsic_key": None, "extrinsic_repaired": False}
    key = _one_of(path, keys, EXTRINSIC_KEYS)
    name = "%s: %s" % (path, key)
    matrix = reader.read(key)
    checks.require_shape(matrix, (4, 4), name)
    checks.require_finite(matrix, name)
    checks.require_within(matrix, MAX_LEVER_ARM, name, "m")
    cam_T_imu, repaired = read_extrinsic(check_transform(matrix, name), key, reading)
    return {"cam_T_imu": cam_T_imu, "extrinsic_key": key, "extrinsic_repaired": repaired}


def _baseline(path, value):
    if value.size != 1:
        raise InputError("%s: b has shape %s, allowed: one number" % (path, value.shape))
    name = "%s: b (baseline)" % path
    baseline = checks.require_positive(float(value.reshape(())), name, "m")
    checks.require_within(value.reshape(1), MAX_BASELINE, name, "m")
    return baseline


def _features(path, features, frames):
    name = "%s: features" % path
    checks.require_shape(features, (4, None, frames), name + " (uL vL uR vR, landmarks, time stamps)")
    checks.require_finite(features, name)
    if features.size and not (-MAX_PIXEL <= features.min() and features.max() <= MAX_PIXEL):
        raise InputError("%s reach from %g to %g px, allowed: within +-%g"
                         % (name, features.min(), features.max(), MAX_PIXEL))
    zeros = ~features.any(axis=0)
    if zeros.any():
        track, frame = np.unravel_index(int(np.argmax(zeros)), zeros.shape)
        raise InputError("%s are 0 0 0 0 px %d times, first of landmark %d at index %d of time_stamps, allowed: "
                         "-1 -1 -1 -1 where it is unseen" % (name, zeros.sum(), track, frame))
    unseen = features == -1.0
    seen = ~unseen.any(axis=0)
    return {"features": features, "seen": seen, "partial": int((~seen & ~unseen.all(axis=0)).sum())}
