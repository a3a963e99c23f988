"""The accelerometer: its unit, gravity in it, its sign; noise and rest of both sensors."""

import numpy as np

# As the node judges the start (sensors/imu_check.cpp): the mean norm, in parts of gravity.
LEAST, MOST = 0.3, 3.0
IN_G = (0.7, 1.4)  # a mean norm, were it in g
IN_MILLI_G = (700.0, 1400.0)
GRAVITY = 9.81  # m/s^2, inertial/gravity
BIAS_SIGMAS = (0.1, 0.2)  # rad/s, m/s^2: inertial/imu_bias_sigma, which a bias may exceed by a factor of 3
WINDOW = 0.5  # s, over which rest is judged
REST = (0.02, 0.15)  # rad/s, m/s^2: standard deviations in a window at rest, above the noise of MEMS and below any motion
NOISE_RATE = 50.0  # Hz, below which motion is between two samples
# Measured over stated noise. Vibration makes it more; Kalibr's authors advise to state a few times what was measured.
NOISE_RATIO = (0.02, 5.0)
UP_LIMIT = 120.0  # deg, between the accelerometer's mean and the upper edge of the picture


def check_accelerometer(rig, report):
    """Unit, and gravity."""
    if not rig.has_acceleration:
        report.unjudged("there is no IMU" if rig.imu is None else "the IMU carries no acceleration; a velocity takes its place")
        return
    norms = np.linalg.norm(rig.imu.acceleration[np.isfinite(rig.imu.acceleration).all(axis=1)], axis=1)
    mean = float(np.mean(norms))
    limit = "%.3g to %.3g m/s^2" % (LEAST * GRAVITY, MOST * GRAVITY)
    report.draw("norm of the acceleration, m/s^2", _draw_norm(rig), "stamp, s", "m/s^2")
    if LEAST * GRAVITY <= mean <= MOST * GRAVITY:
        rest = at_rest(rig)
        if rest.any():
            still = float(np.median(np.linalg.norm(rig.imu.acceleration[rest], axis=1)))
            wide = 3.0 * BIAS_SIGMAS[1]
            if abs(still - GRAVITY) > wide:
                report.yellow("gravity has the wrong length at rest", "%.3f m/s^2" % still, "%.2f +- %.2g m/s^2" % (GRAVITY, wide),
                              "calibrate the accelerometer's scale and bias")
                return
            report.green("gravity at rest", "%.3f m/s^2" % still, "%.2f +- %.2g m/s^2" % (GRAVITY, wide))
            return
        report.green("accelerations are in m/s^2, with gravity", "%.3g m/s^2 in the mean" % mean, limit)
        return
    text, advice = "the accelerometer's unit is wrong", "multiply by what makes gravity %.2f m/s^2" % GRAVITY
    if IN_G[0] <= mean <= IN_G[1]:
        text, advice = "accelerations are in g", "they must be in m/s^2: multiply by 9.80665"
    elif IN_MILLI_G[0] <= mean <= IN_MILLI_G[1]:
        text, advice = "accelerations are in thousandths of g", "they must be in m/s^2: multiply by 0.00980665"
    elif mean < LEAST * GRAVITY:
        text, advice = "gravity is missing in the accelerations", "send what the accelerometer reads (specific force), " \
            "not what is left without gravity"
    report.red(text, "%.3g m/s^2 in the mean" % mean, limit, advice)


def _draw_norm(rig):
    def draw(axes):
        axes.plot(rig.seconds(rig.streams["imu"].stamps), np.linalg.norm(rig.imu.acceleration, axis=1), linewidth=0.5)
        axes.axhline(GRAVITY, color="C2", linewidth=1.0, label="gravity")
    return draw


def at_rest(rig):
    """(N,) whether a sample of the IMU belongs to a window in which nothing moves."""
    t = rig.seconds(rig.streams["imu"].stamps)
    index = np.floor((t - t.min()) / WINDOW).astype(int)
    rest = np.zeros(len(t), dtype=bool)
    for k in np.unique(index):
        inside = index == k
        if inside.sum() < 10:
            continue
        spread = [np.std(values[inside], axis=0).max() for values in (rig.imu.gyro, rig.imu.acceleration)]
        rest[inside] = spread[0] < REST[0] and spread[1] < REST[1] and np.abs(
            rig.imu.gyro[inside].mean(axis=0)).max() < 3.0 * BIAS_SIGMAS[0]
    return rest


def check_up(rig, report):
    """The accelerometer's sign: at rest it reads what holds it against gravity, upwards, and pictures are mostly upright."""
    left_T_imu = rig.left_T_imu()
    if not rig.has_acceleration or left_T_imu is None:
        report.unjudged("it needs accelerations and the transform from the IMU to the camera")
        return
    up = left_T_imu[:3, :3] @ np.nanmean(rig.imu.acceleration, axis=0)
    angle = np.degrees(np.arccos(np.clip(-up[1] / np.linalg.norm(up), -1.0, 1.0)))
    if angle > UP_LIMIT:
        report.yellow("the accelerometer's mean points out of the picture's lower edge", "%.0f deg from up" % angle,
                      "%g deg" % UP_LIMIT, "is the camera upside down? else the accelerometer has the wrong sign: at rest the axis "
                      "that points up must read +9.81")
    else:
        report.green("the accelerometer's mean points upwards in the picture", "%.0f deg" % angle, "%g deg" % UP_LIMIT)


def check_noise(rig, report):
    """Noise from second differences of the quietest windows against what messages or a calibration state; bias at rest."""
    if rig.imu is None:
        report.unjudged("there is no IMU")
        return
    stamps = rig.streams["imu"].stamps
    rate = 1e9 / np.median(np.diff(np.unique(stamps)))
    if rate < NOISE_RATE:
        report.unjudged("at %.3g Hz motion is between two samples; %g Hz are needed" % (rate, NOISE_RATE))
        return
    parts = [("gyro", rig.imu.gyro, rig.imu.gyro_variance, "rad/s", "gyro_density")]
    if rig.has_acceleration:
        parts.append(("accelerometer", rig.imu.acceleration, rig.imu.acceleration_variance, "m/s^2", "accelerometer_density"))
    for name, values, variance, unit, key in parts:
        density = quietest_sigma(values, int(rate * WINDOW)) / np.sqrt(rate)
        stated, source = (np.sqrt(variance / rate), "covariance") if variance > 0.0 else (None, "")
        if rig.noise is not None:
            stated, source = getattr(rig.noise, key), rig.noise_path
        figure = "%.2g %s/sqrt(Hz)" % (density, unit)
        if stated is None:
            report.yellow("the %s's noise is not stated" % name, figure + " in the quietest tenth", "covariance or imu.yaml",
                          "state it: inertial/imu_calibration, Kalibr's imu.yaml; the default is that of an ordinary MEMS IMU")
            continue
        low, high = NOISE_RATIO[0] * stated, NOISE_RATIO[1] * stated
        limit = "%.2g to %.2g; stated: %.2g (%s)" % (low, high, stated, source)
        if density > high:
            report.yellow("the %s is noisier than it states" % name, figure, limit,
                          "state at least %.2g, or look for vibration; is a variance given for a density?" % density)
        elif density < low:
            report.yellow("the %s is far less noisy than it states" % name, figure, limit,
                          "state about %.2g: else what it says hardly counts" % (2.0 * density))
        else:
            report.green("%s noise" % name, figure, limit)


def quietest_sigma(values, width):
    """Standard deviation of white noise of one coordinate, from x0 - 2 x1 + x2 (variance 6 sigma^2) in the quietest tenth of
    windows of `width` samples; smooth motion cancels. values: (N, 3)."""
    second = values[2:] - 2.0 * values[1:-1] + values[:-2]
    second = second[np.isfinite(second).all(axis=1)]
    width = max(10, width)
    count = max(1, len(second) // width)
    sigmas = [np.sqrt(np.mean(part**2) / 6.0) for part in np.array_split(second, count)] if len(second) else [0.0]
    return float(np.percentile(sigmas, 10.0))
