"""Find the frames on which a front end repeated the last frame's pixels, and end the tracks there.

On a stale frame every surviving track repeats all four pixel numbers of the frame before bit for bit, while new tracks
appear: the front end detected anew there and did not track. From the next frame on the same index follows whatever
scene patch lay under the old pixel, which is another point in the world. So the old identity ends at the frame before,
and a new one starts at the stale frame. An index that comes back after a gap was detected by what it looks like, so it
has its own identity again.

A frame is stale when at least MIN_REPEATED surviving tracks repeat, and they are at least MIN_FRACTION of all
survivors. On the known drives the fraction is 1 on stale frames (25 tracks or more) and 0 on all others, so the
thresholds are far from both. A car that really stands still repeats its pixels nearly, but not bit for bit.
"""

from collections import namedtuple

import numpy as np

MIN_REPEATED = 5
MIN_FRACTION = 0.5
UNSEEN = -1

Repair = namedtuple("Repair", "ids stale_frames restarted_tracks")
Repair.__doc__ = """ids: (M, T) int64, -1 where unseen; stale_frames: list of frame indices; restarted_tracks: new ids given out."""


def repeated_tracks(features, seen, frame):
    """(survivors, repeated): masks (M,) of the tracks seen at frame - 1 and frame, and of those with equal pixels."""
    survivors = seen[:, frame - 1] & seen[:, frame]
    repeated = survivors & np.all(features[:, :, frame] == features[:, :, frame - 1], axis=0)
    return survivors, repeated


def is_stale(survivors, repeated):
    """The rule above, on the number of surviving and of repeated tracks."""
    return repeated >= MIN_REPEATED and repeated >= MIN_FRACTION * survivors


def assign_ids(features, seen, repair=True):
    """Track identities per landmark and frame.

    features: (4, M, T) px. seen: (M, T) bool. Landmark m has the id m until a stale frame ends it, and again after
    a frame without it; new ids count upwards from M, frame by frame and in the order of m, so they are the same in every
    run. Stale frames may follow each other. With repair=False stale frames are found and counted but ids stay m.
    """
    landmarks, frames = seen.shape
    current = np.arange(landmarks, dtype=np.int64)
    ids = np.full((landmarks, frames), UNSEEN, dtype=np.int64)
    stale_frames, next_id = [], landmarks
    for k in range(frames):
        if k > 0:
            begins = seen[:, k] & ~seen[:, k - 1]
            current[begins] = np.flatnonzero(begins)
            survivors, repeated = repeated_tracks(features, seen, k)
            count = int(repeated.sum())
            if is_stale(int(survivors.sum()), count):
                stale_frames.append(k)
                if repair:
                    current[repeated] = np.arange(next_id, next_id + count)
                    next_id += count
        ids[seen[:, k], k] = current[seen[:, k]]
    return Repair(ids, stale_frames, next_id - landmarks)
