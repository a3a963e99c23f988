"""Make a real drive worse in known ways: fewer and shorter tracks, gaps, traffic; or its twist better.

Features are handled as a list of frames, each a pair (ids (N,) int64, pixels (4, N) uL vL uR vR). Everything random
comes from a seed. Truth is a pair (stamps, poses) as truth.load_truth gives it: IMU poses at the frames' own stamps.
"""

from collections import Counter

import numpy as np

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse, se3_log
from vi_ekf_slam.dataset.loader import Dataset


def frames_of(dataset, ids):
    """The features of a dataset with the ids of stale.assign_ids."""
    return [(ids[seen, k], dataset.features[:, seen, k]) for k, seen in enumerate(dataset.seen.T)]


def pack(dataset, frames):
    """(dataset, ids) for as_recording with `frames` as the features; a row holds one track after another."""
    rows, count = max([len(ids) for ids, _ in frames] + [1]), len(frames)
    features, ids = np.full((4, rows, count), -1.0), np.full((rows, count), -1, dtype=np.int64)
    for k, (frame_ids, pixels) in enumerate(frames):
        features[:, : len(frame_ids), k], ids[: len(frame_ids), k] = pixels, frame_ids
    return Dataset(**{**vars(dataset), "features": features, "seen": ids >= 0}), ids


def cut_to(dataset, ids, count):
    """The first `count` frames of a dataset and its ids."""
    changes = {"stamps": dataset.stamps[:count], "seen": dataset.seen[:, :count],
               "features": dataset.features[:, :, :count],
               "linear_velocity": dataset.linear_velocity[:, :count],
               "angular_velocity": dataset.angular_velocity[:, :count]}
    return Dataset(**{**vars(dataset), **changes}), ids[:, :count]


def keep_tracks(frames, every):
    """Every `every`-th track, counted in the order in which they appear."""
    if every == 1:
        return frames
    rank = {number: k for k, number in enumerate(dict.fromkeys(number for ids, _ in frames for number in ids))}
    return _select(frames, lambda number, k: rank[number] % every == 0)


def cut_tracks(frames, longest=None, drop_last=0.0):
    """Take the tracks' ends away: all after the first `longest` observations, and the share `drop_last` of each."""
    if longest is None and drop_last == 0.0:
        return frames
    length, seen = Counter(number for ids, _ in frames for number in ids), Counter()
    kept = {number: max(1, int(np.ceil((1.0 - drop_last) * n - 1e-9))) for number, n in length.items()}
    if longest is not None:
        kept = {number: min(n, longest) for number, n in kept.items()}

    def is_kept(number, _):
        seen[number] += 1
        return seen[number] <= kept[number]
    return _select(frames, is_kept)


def black_out(frames, stamps, start, duration):
    """No features from `start` s after the first frame for `duration` s; InputError where no frame is within that."""
    since = stamps - stamps[0]
    dark = (since >= start) & (since < start + duration)
    if not dark.any():
        raise InputError("--blackout %g %g: no frame is within it, allowed: a START from 0 to %.3f s and a DURATION above 0"
                         % (start, duration, since[-1]))
    return _select(frames, lambda _, k: not dark[k])


def good_twist(dataset, truth, velocity_sigma, gyro_sigma, seed):
    """The dataset with its twist replaced by the true one plus white noise of sigmas in m/s and rad/s.

    The true twist at a frame is the symmetric difference Log(T_{k-1}^-1 T_{k+1}) / (t_{k+1} - t_{k-1}), one-sided at
    the ends. Every frame of the dataset needs its true pose.
    """
    stamps, poses = truth
    require_truth(dataset, stamps)
    last, random = len(stamps) - 1, np.random.default_rng(seed)
    twist = np.empty((6, len(stamps)))
    for k in range(len(stamps)):
        before, after = max(k - 1, 0), min(k + 1, last)
        twist[:, k] = se3_log(inverse(poses[before]) @ poses[after]) / (stamps[after] - stamps[before])
    twist += random.normal(size=twist.shape) * np.repeat([velocity_sigma, gyro_sigma], 3)[:, None]
    return Dataset(**{**vars(dataset), "linear_velocity": twist[:3], "angular_velocity": twist[3:]})


def require_truth(dataset, stamps):
    """InputError unless the truth reaches every frame."""
    if len(stamps) != dataset.frames or np.abs(stamps - dataset.stamps).max() > 1e-6:
        raise InputError("%s: the truth has %d poses, allowed: one for each of the %d frames"
                         % (dataset.name, len(stamps), dataset.frames))


def _select(frames, is_kept):
    """Frames with the observations for which is_kept(id, frame index)."""
    kept = []
    for k, (ids, pixels) in enumerate(frames):
        mask = np.array([is_kept(number, k) for number in ids], dtype=bool)
        kept.append((ids[mask], pixels[:, mask]))
    return kept
