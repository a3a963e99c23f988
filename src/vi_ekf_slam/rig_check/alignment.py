"""Hand-eye alignment of a gyro and a camera by their rates, and the offset of their clocks.

The camera's rate at its stamp t is w_c(t) = k C (w(t + o) - b): C the rotation from the IMU's axes to the camera's, o what must be
added to a picture's stamp to have the IMU's time, b the gyro's bias, k a wrong unit. Rates of both are means over the time between
two frames, of the gyro by its integral. For each o, C is the solution of Wahba's problem (Kabsch) for the rates without their means.
"""

from collections import namedtuple

import numpy as np

from vi_ekf_slam.common.geometry import BODY_R_OPTICAL, hat, nearest_rotation, so3_log

Alignment = namedtuple("Alignment", "offset offset_sigma correlation correlations scale mirrored camera gyro sigma index times")
Alignment.__doc__ = """offset, offset_sigma s. correlation: of the rates after alignment, 1 is perfect; correlations: (offsets (M,),
values (M,)). scale (low, high): of the camera's rate over the gyro's; both noises pull it to one side each. mirrored: whether a
reflection fits instead of a rotation. camera, gyro (N, 3) rad/s: rates at that offset, without their means and outliers.
sigma rad/s: of what remains, a coordinate. index (N,): which
steps of the motion they are; times (N,) s after the first."""

MAX_OFFSET, COARSE, FINE = 0.5, 0.005, 0.0005  # s
OUTLIER = 4.0  # sigma
LEAST_STEPS = 20
SIGMAS = 5.0
# Noise alone makes of the entries of camera^T gyro / sigma^2 sqrt(N) sigma_c sigma_g / sigma^2, sqrt(N) / 2 at most, of both signs: a
# prior of ten times that decides the axes of which nothing else tells, and is little beside a turn that is seen.
PRIOR = 10.0 * 0.5
MIRRORED = 0.05  # by which a reflection must fit better, in correlation


def cumulative_integral(t, values):
    """Of values (N, M) at t (N,), from t[0] on, by trapezoids."""
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t)[:, None], axis=0)])


def mean_rate(stamps, rates, begin, end, integral=None):
    """(N, 3) rad/s, mean of sampled rates between begin and end (N,) s, linear between samples; NaN outside of them.

    integral: cumulative_integral of the samples, for who has it.
    """
    integral = cumulative_integral(stamps, rates) if integral is None else integral

    def at(t):
        k = np.clip(np.searchsorted(stamps, t, side="right") - 1, 0, len(stamps) - 2)
        step = stamps[k + 1] - stamps[k]
        s = (t - stamps[k])[:, None]
        value = integral[k] + rates[k] * s + 0.5 * (rates[k + 1] - rates[k]) * s**2 / step[:, None]
        value[(t < stamps[0] - 1e-9) | (t > stamps[-1] + 1e-9)] = np.nan
        return value

    return (at(end) - at(begin)) / (end - begin)[:, None]


def _centred(camera, gyro):
    """Both without their means, as far as both are known."""
    known = np.isfinite(gyro).all(axis=1)
    camera, gyro = camera[known], gyro[known]
    return camera - camera.mean(axis=0), gyro - gyro.mean(axis=0), known


def _correlation(camera, gyro, mirrored=False):
    """sup over rotations (reflections; None: both) C of <camera, C gyro> / (|camera| |gyro|)."""
    if len(camera) < LEAST_STEPS:
        return 0.0
    u, s, vt = np.linalg.svd(camera.T @ gyro)
    sign = np.linalg.det(u @ vt)
    sign = abs(sign) if mirrored is None else -sign if mirrored else sign
    return float((s[0] + s[1] + sign * s[2]) / max(1e-12, np.linalg.norm(camera) * np.linalg.norm(gyro)))


def rotation_near(camera, gyro, sigma, prior):
    """The rotation C that fits camera = C gyro, where the data leave it free the one nearest to `prior` (3, 3).

    It minimises sum |c - C g|^2 / sigma^2 + PRIOR sqrt(N) |C - prior|^2.
    """
    return nearest_rotation(camera.T @ gyro / sigma**2 + PRIOR * np.sqrt(len(camera)) * prior)


def align(motion, stamps, gyro):
    """Alignment of camera_motion.Motion and gyro (N, 3) at stamps (N,) s after its begin, rising; None where too little overlaps."""
    origin = int(motion.begin[0])
    t, begin, end = stamps, (motion.begin - origin) * 1e-9, (motion.end - origin) * 1e-9
    camera = motion.rotation / (end - begin)[:, None]
    # A jump of the camera's own estimate must not decide: three times the largest ordinary rate.
    keep = np.linalg.norm(camera, axis=1) < 3.0 * np.percentile(np.linalg.norm(camera, axis=1), 95.0) + 1e-6
    offsets = np.arange(-MAX_OFFSET, MAX_OFFSET + 0.5 * COARSE, COARSE)
    for attempt in range(2):
        values = _scan(offsets, t, gyro, camera, begin, end, keep)
        best = offsets[int(np.argmax(values))]
        fine = best + np.arange(-2.0 * COARSE, 2.0 * COARSE, FINE)
        curve = _scan(fine, t, gyro, camera, begin, end, keep)
        offset = _peak(fine, curve)
        centred_c, centred_g, known = _centred(camera[keep], mean_rate(t, gyro, begin + offset, end + offset)[keep])
        if len(centred_c) < LEAST_STEPS or not np.any(centred_g):
            return None
        mirrored = _correlation(centred_c, centred_g, True) - _correlation(centred_c, centred_g)
        scale = np.linalg.norm(centred_c) / max(1e-12, np.linalg.norm(centred_g))
        residual = np.linalg.norm(centred_c - scale * centred_g @ rotation_near(
            centred_c, scale * centred_g, 1.0, np.zeros((3, 3))).T, axis=1)
        sigma = max(1e-5, 1.48 * np.median(residual) / np.sqrt(2.4))  # the median of chi-square with 3 degrees is 2.4
        outlier = np.zeros(len(camera), dtype=bool)
        outlier[np.flatnonzero(keep)[known]] = residual > OUTLIER * 1.75 * sigma
        index = np.flatnonzero(keep)[known]
        if attempt == 0 and mirrored < MIRRORED:
            keep &= ~outlier
    overlap = _correlation(centred_c, centred_g, mirrored > MIRRORED)
    dot = overlap * np.linalg.norm(centred_c) * np.linalg.norm(centred_g)
    low, high = dot / np.sum(centred_g**2), np.sum(centred_c**2) / max(1e-12, dot)
    middle = 0.5 * (begin + end)[index]
    slope = np.gradient(centred_g * scale, middle, axis=0)
    offset_sigma = sigma / max(1e-9, np.sqrt(np.sum(slope**2)))
    return Alignment(float(offset), float(offset_sigma), overlap, (offsets, values), (float(low), float(high)),
                     bool(mirrored > MIRRORED), centred_c, centred_g, float(sigma), index, middle)


def _scan(offsets, t, gyro, camera, begin, end, keep):
    values = []
    camera, begin, end, integral = camera[keep], begin[keep], end[keep], cumulative_integral(t, gyro)
    for offset in offsets:
        c, g, known = _centred(camera, mean_rate(t, gyro, begin + offset, end + offset, integral))
        # An offset at which half of the frames lie outside of the gyro's time fits what is left too easily.
        share = known.mean() if len(known) else 0.0
        values.append(_correlation(c, g, None) if share > 0.5 else 0.0)
    return np.array(values)


def _peak(x, y):
    k = int(np.clip(np.argmax(y), 1, len(x) - 2))
    curvature = y[k - 1] - 2.0 * y[k] + y[k + 1]
    return float(x[k] + (0.5 * (x[1] - x[0]) * (y[k - 1] - y[k + 1]) / curvature if curvature < 0.0 else 0.0))


Misalignment = namedtuple("Misalignment", "angle sigmas sure known rotation")
Misalignment.__doc__ = """angle rad: of the least turn that makes a stated rotation fit; sigmas: how many of its sigmas that is. sure rad: what
remains of it when each axis is granted SIGMAS of its own. known rad: sigma about the worst axis. rotation (3, 3): that fits."""


def misalignment(alignment, stated):
    """Misalignment of `stated` (3, 3)."""
    scale = np.sqrt(alignment.scale[0] * alignment.scale[1])
    gyro = scale * alignment.gyro
    found = rotation_near(alignment.camera, gyro, alignment.sigma, stated)
    error = so3_log(found @ stated.T)
    predicted = gyro @ stated.T
    # The gyro's noise is no turn. It is at most what remains, and counts about the two axes across each of its own.
    information = sum(-hat(w) @ hat(w) for w in predicted) / alignment.sigma**2 - 2.0 * len(predicted) * np.eye(3)
    values, axes = np.linalg.eigh(information)
    sigmas = 1.0 / np.sqrt(np.maximum(values, 1e-9))
    parts = np.abs(axes.T @ error)
    return Misalignment(float(np.linalg.norm(error)), float(np.linalg.norm(parts / sigmas)),
                        float(np.linalg.norm(np.maximum(0.0, parts - SIGMAS * sigmas))), float(min(sigmas[0], np.pi)), found)


def axis_turns():
    """The 23 rotations but the identity that exchange axes, those that move least first."""
    turns = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        for signs in np.ndindex(2, 2, 2):
            turn = np.zeros((3, 3))
            turn[range(3), order] = 1.0 - 2.0 * np.array(signs)
            if np.linalg.det(turn) > 0.0 and not np.allclose(turn, np.eye(3)):
                turns.append(turn)
    return sorted(turns, key=lambda turn: -np.trace(turn))


def explain(alignment, stated, limit):
    """Words for what is wrong with `stated` (3, 3) where a simple mistake explains it within `limit` rad, else ""."""
    swap = BODY_R_OPTICAL.T
    candidates = [("it looks inverted: it is the transform of the other direction", stated.T),
                  ("it looks left out: the identity stands for it" if np.allclose(stated, np.eye(3), atol=1e-3) else
                   "the turn from the body's axes to the optical ones is missing", swap @ stated),
                  ("the turn from the body's axes to the optical ones is made twice", swap.T @ stated),
                  ("it looks left out: both have the same axes", np.eye(3))]
    candidates += [("axes look exchanged, %s" % _words(turn), stated @ turn) for turn in axis_turns()]
    for text, candidate in candidates:
        found = misalignment(alignment, candidate)
        if found.angle < limit or found.sigmas < 3.0 and found.angle < 2.0 * limit:
            return text
    return ""


def _words(turn):
    """Which axes of the IMU are taken for x, y and z."""
    names = []
    for row in turn:
        k = int(np.argmax(np.abs(row)))
        names.append(("-" if row[k] < 0 else "") + "xyz"[k])
    return "x, y, z of the transform are the IMU's %s" % ", ".join(names)

