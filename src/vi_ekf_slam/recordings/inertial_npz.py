"""A drive with an accelerometer as an .npz: IMU, rectified stereo points with their noise, truth and states to start from.

| key | shape | meaning |
| --- | --- | --- |
| t_offset | | s; every other time is seconds after it |
| imu_t, imu_gyro, imu_accel | N, N x 3 | s, rad/s, m/s^2 (specific force), IMU axes |
| gyro_density, gyro_walk, accel_density, accel_walk, imu_rate | | noise of the IMU, see imu_noise.py |
| K, baseline, image_size | 3 x 3, 1, 2 | of the rectified pair: px, m, width and height |
| imu_T_rectleft | 4 x 4 | the rectified left camera on the IMU |
| gravity | 3 | m/s^2 in the world frame, downwards along z |
| cam_t, frame_ptr | T, T + 1 | s; frame k has the rows frame_ptr[k] to frame_ptr[k + 1] of what follows |
| id, uv, sigma_q | M, M x 4, M x 4 | track, uL vL uR vR in px, standard deviation of each in 1/64 px |
| truth_t, truth_q, truth_p | L, L x 4, L x 3 | s, quaternion x y z w of world_T_imu, m |
| init_tight | 16 | quaternion, position, velocity, gyro and accelerometer bias at truth_t[0] |
| P0_tight | 15 x 15 | covariance of it: (rotation in IMU axes, position, velocity, biases), estimate minus truth |
"""

import os

import numpy as np

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import make_transform
from vi_ekf_slam.dataset.extrinsic import check_transform
from vi_ekf_slam.dataset.loader import MAX_BASELINE, MAX_PIXEL
from vi_ekf_slam.dataset.npz_reader import NpzReader
from vi_ekf_slam.dataset.pose_files import quaternions_to_poses
from vi_ekf_slam.recordings.imu_noise import LARGEST, UNITS, ImuNoise
from vi_ekf_slam.recordings.initial_state import covariance_about_map
from vi_ekf_slam.recordings.recording import (Features, Imu, InitialState, Recording, rectified_pair, require_increasing)

NOISE_KEYS = ("gyro_density", "gyro_walk", "accel_density", "accel_walk", "imu_rate")  # in the order of ImuNoise
KEYS = ("imu_t", "imu_gyro", "imu_accel", "cam_t", "frame_ptr", "uv")  # by which the format is known
SIGMA_STEPS = 64.0  # of sigma_q in a pixel
WEIGHTS = np.array([2.0, 1.0, 2.0, 1.0]) / 6.0  # of the variances of uL, vL, uR and vR
MAX_ID = 2.0**53  # arrays are read as float64, in which ids from there on are no longer told apart


def load_inertial_npz(path, max_memory_mb):
    """Read and check `path`; returns a Recording. InputError names the file, the key, the value and what is allowed."""
    with NpzReader(path, max_memory_mb) as reader:
        npz = _Checked(path, reader)
        offset = checks.nanoseconds(npz.array("t_offset", ())[()])
        imu_stamps, frame_stamps = npz.stamps("imu_t", offset), npz.stamps("cam_t", offset)
        noise = ImuNoise(*(npz.positive(key, LARGEST, unit) for key, unit in zip(NOISE_KEYS, UNITS + ("Hz",))))
        imu = Imu(imu_stamps, npz.array("imu_gyro", (len(imu_stamps), 3)), npz.array("imu_accel", (len(imu_stamps), 3)),
                  noise)
        features = _features(npz, frame_stamps)
        intrinsics = npz.array("K", (3, 3))
        checks.require_intrinsics(intrinsics, "%s: K" % path)
        features, size, shift = _whole_picture(features, npz.image_size())
        intrinsics[:2, 2] += shift
        baseline = npz.positive("baseline", MAX_BASELINE, "m")
        left, right = rectified_pair(size, intrinsics, baseline)
        truth_stamps = npz.stamps("truth_t", offset)
        truth = truth_stamps, npz.poses("truth_q", "truth_p", len(truth_stamps))
        gravity = npz.array("gravity", (3,))
        if gravity[0] != 0.0 or gravity[1] != 0.0 or not gravity[2] < 0.0:
            raise InputError("%s: gravity is %s, allowed: 0 0 -g, since the map's z points upwards" % (path, gravity))
        return Recording(
            os.path.splitext(os.path.basename(path))[0], imu=imu, features=features, left=left, right=right,
            imu_T_left=check_transform(npz.array("imu_T_rectleft", (4, 4)), "%s: imu_T_rectleft" % path),
            left_T_right=make_transform(np.eye(3), [baseline, 0.0, 0.0]), truth=truth,
            initial_state=_initial_state(npz, int(truth_stamps[0])),
            notes=["gravity: %g m/s^2" % -gravity[2],
                   "image: %d x %d px, the principal point moved by (%d, %d) px with all pixels, so that each is in it"
                   % (*size, *shift)])


class _Checked:
    """Arrays of a reader with their shapes and values checked."""

    def __init__(self, path, reader):
        self.path, self._reader = path, reader

    def array(self, key, shape):
        """Finite, of this shape."""
        name = "%s: %s" % (self.path, key)
        array = self._reader.read(key)
        checks.require_shape(array, shape, name)
        checks.require_finite(array, name)
        return array

    def positive(self, key, limit, unit):
        """A number above zero, of the unit."""
        value = self.array(key, ())
        checks.require_within(value.reshape(1), limit, "%s: %s" % (self.path, key), unit)
        return checks.require_positive(float(value), "%s: %s" % (self.path, key))

    def image_size(self):
        """(2,) px."""
        size = self.array("image_size", (2,))
        if not (1.0 <= size.min() and size.max() <= MAX_PIXEL):
            raise InputError("%s: image_size is %g x %g px, allowed: from 1 to %g" % (self.path, *size, MAX_PIXEL))
        return size

    def stamps(self, key, offset):
        """(N,) ns; `offset` ns is added."""
        seconds = self.array(key, (None,))
        if len(seconds) < 2:
            raise InputError("%s: %s has %d entries, allowed: two or more" % (self.path, key, len(seconds)))
        checks.require_within(seconds, checks.MAX_ROS_SECONDS, "%s: %s" % (self.path, key), "s")
        stamps = offset + checks.nanoseconds(seconds)
        require_increasing(stamps, "%s: %s" % (self.path, key))
        return stamps

    def poses(self, quaternion_key, position_key, count):
        """(count, 4, 4)."""
        return quaternions_to_poses(self.array(quaternion_key, (count, 4)), self.array(position_key, (count, 3)),
                                    lambda k: "%s: %s[%d]" % (self.path, quaternion_key, k))


def _features(npz, stamps):
    starts = npz.array("frame_ptr", (len(stamps) + 1,))
    ids = npz.array("id", (None,))
    pixels, sigmas = npz.array("uv", (len(ids), 4)), npz.array("sigma_q", (len(ids), 4))
    for key, values in (("frame_ptr", starts), ("id", ids)):
        if (values != np.floor(values)).any() or (values < 0).any():
            raise InputError("%s: %s holds %g, allowed: whole numbers from 0 on"
                             % (npz.path, key, values[(values != np.floor(values)) | (values < 0)][0]))
    if len(ids) and ids.max() >= MAX_ID:
        raise InputError("%s: id holds %g, allowed: below 2^53" % (npz.path, ids.max()))
    if starts[0] != 0 or starts[-1] != len(ids) or (np.diff(starts) < 0).any():
        raise InputError("%s: frame_ptr goes from %d to %d, allowed: from 0 up to the %d rows, never down"
                         % (npz.path, starts[0], starts[-1], len(ids)))
    checks.require_within(pixels, MAX_PIXEL, "%s: uv" % npz.path, "px")
    if len(sigmas) and sigmas.min() <= 0.0:
        raise InputError("%s: sigma_q holds %g, allowed: above 0" % (npz.path, sigmas.min()))
    # One number a point: the root of the mean variance of what the filter measures of it, uL, uR and the mean of vL and vR,
    # whose variance it takes for half of that number's square.
    sigma = np.sqrt(sigmas**2 @ WEIGHTS) / SIGMA_STEPS
    return Features(stamps, starts.astype(np.int64), ids.astype(np.int64), pixels, sigma)


def _whole_picture(features, size):
    """A rectified picture that holds all pixels: what is undistorted may lie beyond the borders of the picture as taken.

    Returns (features, size, shift): by `shift` (2,) px, whole numbers, the pixels have moved.
    """
    columns, rows = features.pixels[:, [0, 2]], features.pixels[:, [1, 3]]
    shift = np.array([max(0.0, np.ceil(-values.min(initial=0.0))) for values in (columns, rows)])
    largest = np.array([values.max(initial=0.0) for values in (columns, rows)]) + shift
    size = np.maximum(size + shift, np.floor(largest) + 1.0)
    return features._replace(pixels=features.pixels + np.tile(shift, 2)), tuple(int(s) for s in size), shift


def _initial_state(npz, stamp):
    state, covariance = npz.array("init_tight", (16,)), npz.array("P0_tight", (15, 15))
    name = "%s: P0_tight" % npz.path
    if np.abs(covariance - covariance.T).max() > 1e-9 * np.abs(covariance).max():
        raise InputError("%s is not symmetric" % name)
    if not np.linalg.eigvalsh(covariance)[0] > 0.0:
        raise InputError("%s has the eigenvalue %g, allowed: all above 0" % (name, np.linalg.eigvalsh(covariance)[0]))
    pose = quaternions_to_poses(state[None, :4], state[None, 4:7], lambda _: "%s: init_tight" % npz.path)[0]
    return InitialState(stamp, pose, state[7:10], state[10:13], state[13:16], covariance_about_map(covariance, pose[:3, :3]))
