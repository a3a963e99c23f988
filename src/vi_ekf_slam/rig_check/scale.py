"""The camera's speed, which the baseline scales, against what a velocity or the accelerometer says."""

import numpy as np

from vi_ekf_slam.common.geometry import inverse, so3_exp
from vi_ekf_slam.rig_check import alignment as align
from vi_ekf_slam.rig_check.imu_units import BIAS_SIGMAS, GRAVITY

LEAST_SPEED = 0.3  # m/s, the camera's, for a step to count
LEAST_STEPS = 20
# A wheel's circumference is known to 0.03; beyond 0.1 a loop does not close within a map's gates.
YELLOW, RED = 0.03, 0.10
DIRECTION_YELLOW, DIRECTION_RED = 5.0, 20.0  # deg, of the mean travel: slip and the points' noise make less
FREE = 0.05  # weight of no turn at all: a car that drives straight ahead does not tell its camera's roll
WINDOW = 1.0  # s over which the accelerometer is integrated twice
MOST_SIGMA = 0.03  # share of the scale, for it to be judged: the error of what is scaled grows with it
MOST_GRAVITY_ERROR = 0.05  # share, of what the same fit finds and is known: a sound fit is right about both
# Steps whose errors are one: a window's positions share those of the steps before, and points are off alike for a second (of KITTI's
# drives the ratios of speeds are correlated as if 2 to 11 steps counted as one).
SAME = 10.0
NANO = 1e-9


def check_scale(rig, report):
    """Ratio of speeds, and direction of travel."""
    if rig.motion is None or rig.cameras is None:
        report.unjudged("the camera's motion is not known")
    elif rig.velocity is not None and rig.cam_T_imu is not None:
        _by_velocity(rig, report)
    elif rig.has_acceleration and rig.gyro_bias is not None:
        _by_accelerometer(rig, report)
    else:
        report.unjudged("it needs a velocity or an accelerometer, a rig that turns, and the transform to the camera")


def _by_velocity(rig, report):
    motion, stream = rig.motion, rig.streams[rig.velocity_name]
    stamps, index = np.unique(stream.stamps, return_index=True)
    good = np.isfinite(rig.velocity[index]).all(axis=1)
    t, velocity = (stamps[good] - motion.begin[0]) * NANO, rig.velocity[index][good]
    begin, end = (motion.begin - motion.begin[0]) * NANO, (motion.end - motion.begin[0]) * NANO
    told = align.mean_rate(t, velocity, begin, end)
    seen = motion.translation / (end - begin)[:, None]
    # The camera's own velocity, about the IMU: v + w x (camera on the IMU).
    C = rig.cam_T_imu[:3, :3]
    rate = motion.rotation / (end - begin)[:, None] @ C
    told = told + np.cross(rate, inverse(rig.cam_T_imu)[:3, 3])
    speeds = np.linalg.norm(told, axis=1), np.linalg.norm(seen, axis=1)
    fast = (speeds[0] > LEAST_SPEED) & (speeds[1] > LEAST_SPEED)  # NaN is not
    if fast.sum() < LEAST_STEPS:
        report.unjudged("the rig hardly moves: %d steps above %g m/s, %d are needed" % (fast.sum(), LEAST_SPEED, LEAST_STEPS))
        return
    # Along what is told: noise across it makes a step longer, but not the way.
    ratios = np.sum(seen * (told @ C.T), axis=1)[fast] / speeds[0][fast] ** 2
    report.draw("speed of the camera, m/s: by its points, and as told", _draw_speeds(begin, *speeds), "s", "m/s")
    ratio = float(np.median(ratios))
    spread = 1.48 * np.median(np.abs(ratios - ratio)) * np.sqrt(SAME / fast.sum())
    off = _direction(seen[fast], told[fast] @ C.T)
    if off > DIRECTION_YELLOW:
        report.complain(
            off > DIRECTION_RED, "the camera does not travel where the velocity points", "%.1f deg off" % off,
            "%g deg" % DIRECTION_YELLOW,
            "is the velocity backwards, or of another frame than its %s ('%s') says? or is the camera's transform wrong?" % (
                "child_frame_id" if rig.velocity_name == "wheel_odometry" else "frame_id", stream.frame_id))
        return
    report.green("direction of travel", "%.1f deg" % off, "%g deg" % DIRECTION_YELLOW)
    if not spread < MOST_SIGMA * ratio:
        report.unjudged("the points tell the camera's speed too badly for the scale (%.2f +- %.2f): pass by nearer things, or see the "
                        "sharpness of the pictures" % (ratio, 3.0 * spread))
        return
    _say_scale(report, ratio, spread, "the velocity", "the velocity's unit or scale (wheel circumference)")


def _say_scale(report, ratio, sigma, source, other):
    figure = "the camera's speed is %.3f times that of %s, +- %.3f" % (ratio, source, 3.0 * sigma)
    error, noise = abs(np.log(ratio)), 3.0 * sigma / ratio
    if error < max(YELLOW, noise):
        report.green("the baseline's scale", figure, "1 +- %g" % YELLOW)
        return
    report.complain(
        error > max(RED, noise), "the scale of the baseline does not fit %s" % source, figure, "1 +- %g" % YELLOW,
        "right P[3] = -fx * baseline in m: the baseline would be %.3f of what is stated; or %s is wrong" % (1.0 / ratio, other))


def _direction(seen, told):
    """deg, of the least turn that lays told (N, 3) onto seen (N, 3) m/s, both in the camera's axes; 180 where they are opposite."""
    # seen = told + e x told for a small turn e, so that told x seen = (I - told told^T) e; what the travel leaves free stays 0.
    told, seen = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (told, seen))
    if np.sum(seen * told) < 0.0:
        return 180.0
    information = len(told) * (1.0 + FREE) * np.eye(3) - told.T @ told
    return float(np.degrees(np.linalg.norm(np.linalg.solve(information, np.cross(told, seen).sum(axis=0)))))


def _by_accelerometer(rig, report):
    """q_k = r (v_0 t + g t^2 / 2 + the accelerations integrated twice - the bias' part of them): least squares for r, and r times v_0 of each
    window, g and the bias. q_k is the camera's way: noisy, so that it must not be what is multiplied."""
    rows = _equations(rig)
    if rows is None:
        report.unjudged("there are too few windows of %g s in which frames follow each other" % WINDOW)
        return
    A, b = rows
    weights = np.ones(len(b))
    weights[-3:] = 0.0
    for _ in range(2):  # the prior of the bias, once the residual is known
        solution, *_ = np.linalg.lstsq(A * weights[:, None], b * weights, rcond=None)
        residual = (b - A @ solution)[:-3]
        sigma = 1.48 * float(np.median(np.abs(residual)))
        weights[-3:] = sigma * np.sqrt(SAME) / BIAS_SIGMAS[1]
    weighted = A * weights[:, None]
    ratio = solution[0]
    sigma *= np.sqrt(SAME * np.linalg.pinv(weighted.T @ weighted)[0, 0])
    if not sigma < MOST_SIGMA * abs(ratio):
        report.unjudged("accelerations are too small to tell the scale (%.2f +- %.2f): shake the rig" % (ratio, 3.0 * sigma))
        return
    if ratio < 0.0:
        report.red("accelerations have the wrong sign", "the camera speeds up where the accelerometer slows down", "the same sign",
                   "at rest the axis that points up must read +9.81 m/s^2")
        return
    gravity = float(np.linalg.norm(solution[1:4])) / ratio
    if abs(gravity / GRAVITY - 1.0) > MOST_GRAVITY_ERROR:
        report.unjudged("the fit of accelerations to the camera's way is poor: it makes gravity %.2f m/s^2; shake the rig, near textured things"
                        % gravity)
        return
    _say_scale(report, ratio, sigma, "the accelerometer", "the accelerometer's scale")


def _equations(rig):
    motion, origin, C = rig.motion, int(rig.motion.begin[0]), rig.cam_T_imu[:3, :3]
    stamps, index = np.unique(rig.streams["imu"].stamps, return_index=True)
    t = (stamps - origin) * NANO
    gyro, force = rig.imu.gyro[index] - rig.gyro_bias, rig.imu.acceleration[index]
    begin, end = ((x - origin) * NANO + rig.alignment.offset for x in (motion.begin, motion.end))
    lever = inverse(rig.cam_T_imu)[:3, 3]
    known = np.flatnonzero(np.isfinite(motion.translation).all(axis=1))
    chains = np.split(known, np.flatnonzero(motion.begin[known[1:]] != motion.end[known[:-1]]) + 1)
    windows = []
    for chain in chains:
        if len(chain) < 5:
            continue
        if begin[chain[0]] < t[0] or end[chain[-1]] > t[-1]:
            continue
        inside = slice(np.searchsorted(t, begin[chain[0]], "right") - 1, np.searchsorted(t, end[chain[-1]]) + 1)
        if len(t[inside]) < 3 * len(chain):
            continue
        windows += _windows(chain, begin, end, t[inside], gyro[inside], force[inside], C, lever, motion)
    # Gravity is one vector for the longest chain alone, whose axes the others do not know.
    windows = [w for w in windows if w[0] == max({w[0] for w in windows}, key=lambda c: sum(x[0] == c for x in windows))]
    if len(windows) < 4:
        return None
    A, b = [], []
    for n, (_, times, turned, seen, integral, by_bias) in enumerate(windows):
        for k, T in enumerate(times):
            row = np.zeros((3, 7 + 3 * len(windows)))
            row[:, 0] = integral[k] - turned[k]
            row[:, 1:4] = 0.5 * T**2 * np.eye(3)
            row[:, 4:7] = -by_bias[k]
            row[:, 7 + 3 * n:10 + 3 * n] = T * np.eye(3)
            A.append(row)
            b.append(seen[k])
    prior = np.zeros((3, A[0].shape[1]))
    prior[:, 4:7] = np.eye(3)
    A, b = A + [prior], b + [np.zeros(3)]
    return np.concatenate(A), np.concatenate(b)


def _windows(chain, begin, end, t, gyro, force, C, lever, motion):
    """[(chain's first step, times, lever arm's motion, camera's motion, integral, its derivative by the bias)], in the IMU's axes at the
    beginning of the chain."""
    rotations = [np.eye(3)]
    for k in range(len(t) - 1):
        rotations.append(rotations[-1] @ so3_exp(0.5 * (gyro[k] + gyro[k + 1]) * (t[k + 1] - t[k])))
    rotations = np.array(rotations)
    # The acceleration along the chain's axes and its derivative by the bias, integrated once and twice.
    felt = np.concatenate([np.einsum("nij,nj->ni", rotations, force), rotations.reshape(-1, 9)], axis=1)
    once = align.cumulative_integral(t, felt)
    twice = align.cumulative_integral(t, once)

    def rotation_at(time):
        k = min(int(np.searchsorted(t, time)), len(t) - 1)
        return rotations[k] @ so3_exp(gyro[k] * (time - t[k]))

    def at(table, time):
        return np.array([np.interp(time, t, column) for column in table.T])

    found, first = [], 0
    while first < len(chain):
        steps = [n for n in range(first, len(chain)) if end[chain[n]] - begin[chain[first]] <= WINDOW + 1e-6]
        if len(steps) < 4:
            break
        start = begin[chain[first]]
        R0, once0, twice0 = rotation_at(start), at(once, start), at(twice, start)
        times, turned, seen, integral, by_bias = [], [], [], [], []
        position = np.zeros(3)
        for n in steps:
            s = chain[n]
            position = position + rotation_at(begin[s]) @ C.T @ motion.translation[s]
            T = end[s] - start
            moved = at(twice, end[s]) - twice0 - once0 * T
            times.append(T)
            seen.append(position)
            turned.append((R0 - rotation_at(end[s])) @ lever)
            integral.append(moved[:3])
            by_bias.append(moved[3:].reshape(3, 3))
        found.append((int(chain[0]), times, turned, seen, integral, by_bias))
        first = steps[-1] + 1
    return found


def _draw_speeds(t, told, seen):
    def draw(axes):
        axes.plot(t, seen, ".", markersize=3, label="by points")
        axes.plot(t, told, linewidth=0.8, label="told")
    return draw
