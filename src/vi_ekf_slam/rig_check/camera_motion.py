"""How the left camera turns and moves from frame to frame: triangulated points of one frame, seen in the next (PnP, RANSAC), refined."""

from collections import namedtuple

import cv2
import numpy as np

from vi_ekf_slam.common.geometry import so3_log
from vi_ekf_slam.rig_check.images import read_pairs
from vi_ekf_slam.rig_check.two_frames import refine

Motion = namedtuple("Motion", "begin end rotation translation tracks rotation_sigma picture_ms")
Motion.__doc__ = """N steps. begin, end (N,) ns: stamps. rotation (N, 3) rad: Log of the rotation from the axes at the end to those at
the beginning; translation (N, 3) m of the camera, in its axes at the beginning, NaN: the points do not tell it. tracks (N,): points
that agree. rotation_sigma (N,) rad: standard deviation of the rotation, of all axes together, by the points' residuals. picture_ms: ms
of wall time to find the points of one pair; 0 for features."""

MAX_FRAMES = 200  # that are looked at: those in which the gyro, or else time, is busiest
FEWEST = 12  # points of a step
INLIER = 3.0  # px, RANSAC, to begin with: a near point is off by more than its pixel, since its depth is
MIN_DISPARITY = 0.5  # px: of points to begin with
# s: between two frames closer together points hardly move, and noise divided by a short time counts as motion. 10 Hz, with jitter.
MIN_STEP = 0.09
MAX_STEP = 0.5  # s: beyond it two frames are not neighbours
CORNERS = 200
WINDOW, LEVELS = (21, 21), 4
ROUND_TRIP = 1.0  # px


def estimate_motion(rig):
    """Motion, or None where there is nothing to see it by."""
    if rig.cameras is None:
        return None
    rows, times, ms = [], [], []
    for begin, end, before, after, wall in steps(rig):
        found = _solve(rig.cameras[0].P[:, :3], _baseline(rig), before, after, "features" not in rig.streams)
        if found is not None:
            times.append((begin, end))
            rows.append(found)
            ms.append(wall)
    if not rows:
        return None
    times, table = np.array(times, dtype=np.int64), np.array(rows)
    return Motion(times[:, 0], times[:, 1], table[:, :3], table[:, 3:6], table[:, 6], table[:, 7], float(np.median(ms)))


def steps(rig):
    """[(begin ns, end ns, before (N, 4) px uL vL uR vR, after (N, 2) px of the left picture, ms)], found once."""
    if rig.steps is None:
        rig.steps = list(_features(rig) if "features" in rig.streams else _pictures(rig))
    return rig.steps


def _baseline(rig):
    P = rig.cameras[1].P
    return -P[0, 3] / P[0, 0]


def _solve(K, baseline, before, after, corners):
    """(8,) rotation, translation, number of points, the rotation's sigma; None where they do not agree. before (N, 4), after (N, 2) px.
    corners: whether the points are corners of the left picture before."""
    disparity = before[:, 0] - before[:, 2]
    sound = (np.abs(before[:, 1] - before[:, 3]) < 3.0) & np.isfinite(disparity) & np.isfinite(after).all(axis=1)
    near = sound & (disparity > MIN_DISPARITY)
    if near.sum() < FEWEST:
        return None
    depth = K[0, 0] * baseline / disparity[near]
    points = np.column_stack([(before[near, :2] - K[:2, 2]) / [K[0, 0], K[1, 1]], np.ones(len(depth))]) * depth[:, None]
    # EPNP of few points fails on far ones; it starts from no motion, which neighbouring frames are near to.
    ok, rotation, translation, inliers = cv2.solvePnPRansac(
        points, np.ascontiguousarray(after[near]), K, None, np.zeros((3, 1)), np.zeros((3, 1)), True, 100, INLIER, 0.999, None,
        cv2.SOLVEPNP_ITERATIVE)
    if not ok or inliers is None or len(inliers) < max(FEWEST, 0.3 * len(points)):
        return None
    agree = np.zeros(len(before), dtype=bool)
    agree[np.flatnonzero(near)[inliers.ravel()]] = True
    # Of all points: to take those alone whose disparity noise makes large is to take near ones for far ones.
    found = refine(K, baseline, before[sound], after[sound], (cv2.Rodrigues(rotation)[0], translation.ravel()), agree[sound], corners)
    if found is None or found[3].sum() < max(FEWEST, 0.3 * sound.sum()):
        return None
    after_R_before, translation, sigma, agree = found
    return np.concatenate([-so3_log(after_R_before), -(after_R_before.T @ translation), [agree.sum(), sigma]])


def _apart(stamps):
    """Indices of the frames that are taken, the first and each that is MIN_STEP after the one before. stamps (N,) ns, rising."""
    taken = []
    for k, stamp in enumerate(stamps):
        if not taken or stamp - stamps[taken[-1]] >= MIN_STEP * 1e9:
            taken.append(k)
    return np.array(taken, dtype=int)


def busiest(rig, stamps):
    """Slice of at most MAX_FRAMES frames in a row: where the gyro turns most."""
    if len(stamps) <= MAX_FRAMES:
        return slice(0, len(stamps))
    if rig.imu is None:
        return slice(0, MAX_FRAMES)
    rate = np.linalg.norm(np.nan_to_num(rig.imu.gyro), axis=1)
    order = np.argsort(rig.streams["imu"].stamps, kind="stable")
    energy = np.interp(stamps.astype(float), rig.streams["imu"].stamps[order].astype(float), rate[order])
    total = np.concatenate([[0.0], np.cumsum(energy)])
    begin = int(np.argmax(total[MAX_FRAMES:] - total[:-MAX_FRAMES]))
    return slice(begin, begin + MAX_FRAMES)


def _features(rig):
    stamps = rig.streams["features"].stamps
    order = np.argsort(stamps, kind="stable")
    order = order[_apart(stamps[order])]
    order = order[busiest(rig, stamps[order])]
    for a, b in zip(order[:-1], order[1:]):
        if not 0 < stamps[b] - stamps[a] < MAX_STEP * 1e9:
            continue
        (ids_a, pixels_a), (ids_b, pixels_b) = rig.frames[a], rig.frames[b]
        _, in_a, in_b = np.intersect1d(ids_a, ids_b, return_indices=True)
        if len(in_a) >= FEWEST:
            yield stamps[a], stamps[b], pixels_a[in_a], pixels_b[in_b][:, :2], 0.0


def _pictures(rig):
    if rig.pairs is None or not len(rig.pairs):
        return
    stamps = rig.streams["left_image"].stamps[rig.pairs[:, 0]]
    apart = _apart(stamps)
    part = apart[busiest(rig, stamps[apart])]
    stamps, held, last = stamps[part], None, None
    rectify = [camera.rectify if not rig.rectified else (lambda pixels: pixels.astype(float)) for camera in rig.cameras]
    for k, left, right in read_pairs(rig, rig.pairs[part]):
        if left is None or right is None or left.shape != right.shape:
            held = None
            continue
        start = cv2.getTickCount()
        if held is not None and last == k - 1 and 0 < stamps[k] - stamps[k - 1] < MAX_STEP * 1e9:
            picture, corners, in_right = held
            after, kept = _flow(picture, left, corners)
            before = np.column_stack([rectify[0](corners[kept]), rectify[1](in_right[kept])])
            wall = 1e3 * (cv2.getTickCount() - start) / cv2.getTickFrequency()
            if len(before) >= FEWEST:
                yield stamps[k - 1], stamps[k], before, rectify[0](after[kept]), wall + spent
        start = cv2.getTickCount()
        corners = cv2.goodFeaturesToTrack(left, CORNERS, 0.01, max(8, left.shape[1] // 50))
        held, last = None, k
        if corners is None:
            continue
        corners = corners.reshape(-1, 2)
        in_right, kept = _flow(left, _as_bright_as(left, right), corners)
        held = left, corners[kept], in_right[kept]
        spent = 1e3 * (cv2.getTickCount() - start) / cv2.getTickFrequency()


def _as_bright_as(reference, image):
    """The image with the mean and contrast of the reference: flow compares grey levels, and cameras may differ in exposure."""
    (mean, sigma), (own_mean, own_sigma) = (cv2.meanStdDev(picture) for picture in (reference, image))
    gain = float(sigma[0, 0] / max(own_sigma[0, 0], 1.0))
    return cv2.convertScaleAbs(image, alpha=gain, beta=float(mean[0, 0] - gain * own_mean[0, 0]))


def _flow(first, second, points):
    """(N, 2) px in the second picture, and (N,) which came back by the way they went."""
    if not len(points):
        return points, np.zeros(0, dtype=bool)
    points = points.astype(np.float32).reshape(-1, 1, 2)
    there, found, _ = cv2.calcOpticalFlowPyrLK(first, second, points, None, winSize=WINDOW, maxLevel=LEVELS)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(second, first, there, None, winSize=WINDOW, maxLevel=LEVELS)
    off = np.linalg.norm((back - points).reshape(-1, 2), axis=1)
    return there.reshape(-1, 2), (found.ravel() > 0) & (returned.ravel() > 0) & (off < ROUND_TRIP)
