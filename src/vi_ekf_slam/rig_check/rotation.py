"""What the gyro and the camera say of one turn: unit and signs of the gyro, the extrinsic's rotation, the clocks' offset, the bias."""

import numpy as np

from vi_ekf_slam.common.geometry import rotation_to_quaternion
from vi_ekf_slam.rig_check import alignment as align
from vi_ekf_slam.rig_check.calibration import Camera
from vi_ekf_slam.rig_check.camera_motion import estimate_motion
from vi_ekf_slam.rig_check.imu_units import BIAS_SIGMAS, GRAVITY

LEAST_RATE = 0.03  # rad/s, standard deviation of the camera's rate: ten times its noise with 100 tracks at 10 Hz
NOISES = 3.0  # and so many times the noise that the points of this recording make: less of it may be noise alone
LEAST_CORRELATION = 0.8
DEGREES = 180.0 / np.pi
UNIT_TOLERANCE = 1.25  # factor, about a unit that is taken for another; beyond it, whatever the unit, it is red
SCALE_LIMITS = (0.9, 1.1)  # a MEMS gyro's scale is good to 0.03, the camera's focal length better
# A tilt by this turns gravity into an acceleration of the accelerometer's prior bias, which the filter can still take.
ANGLE_YELLOW = BIAS_SIGMAS[1] / GRAVITY  # rad
ANGLE_RED = 3.0 * ANGLE_YELLOW
# px that all points move by in the time of the offset, when the camera turns as fast as it does at 95 %.
# 2 sigma of invariant/pixel_sigma: less is lost in what the points are off themselves; 5: beyond what gates let pass.
PIXELS_YELLOW, PIXELS_RED = 2.0, 5.0


def check_gyro(rig, report):
    """Unit and signs. Estimates the camera's motion and its alignment with the gyro, which later checks use."""
    rig.motion = estimate_motion(rig)
    if rig.motion is None or len(rig.motion.begin) < align.LEAST_STEPS:
        seen = 0 if rig.motion is None else len(rig.motion.begin)
        if rig.cameras is not None and rig.frame_name and len(rig.streams[rig.frame_name].stamps) > 40:
            report.red("the camera's motion cannot be told", "%d steps between two frames" % seen,
                       "%d" % align.LEAST_STEPS,
                       "too few points are tracked: see texture and exposure, and do the ids of features last?")
        else:
            report.unjudged("the camera's motion is not known: %d steps between two frames, %d are needed" % (seen, align.LEAST_STEPS))
        return
    if rig.imu is None:
        report.unjudged("there is no gyro")
        return
    if not _align(rig, report):
        return
    a = rig.alignment
    low, high = a.scale
    figure = "the camera turns %.4g to %.4g times as fast (correlation %.3f)" % (low, high, a.correlation)
    limit, unsure = "%g to %g" % SCALE_LIMITS, 3.0 * a.sigma / np.linalg.norm(a.gyro)
    for factor, text, advice in ((1.0 / DEGREES, "the gyro is in deg/s", "it must be in rad/s: multiply by pi / 180"),
                                 (DEGREES, "the gyro is converted to rad/s twice", "multiply by 180 / pi")):
        if low < UNIT_TOLERANCE * factor and high > factor / UNIT_TOLERANCE:
            report.red(text, figure, limit, advice)
            return
    if a.mirrored:
        report.red("an axis of the gyro has the wrong sign", "a reflection fits better than any rotation (%.3f)" % a.correlation, "a rotation",
                   "axes must be right-handed: x forward, y left, z up, positive counter-clockwise")
    elif low > SCALE_LIMITS[1] >= low - unsure or high < SCALE_LIMITS[0] <= high + unsure:
        report.unjudged("%s, +- %.2g: turn the rig faster" % (figure, unsure))
    elif low > SCALE_LIMITS[1] or high < SCALE_LIMITS[0]:
        report.complain(low - unsure > UNIT_TOLERANCE or high + unsure < 1.0 / UNIT_TOLERANCE,
                        "gyro and camera differ in how fast they turn", figure, limit,
                        "is the focal length in camera_info that of this resolution? is the gyro's scale right?")
    else:
        report.green("gyro and camera turn equally fast", figure, limit)


def _align(rig, report):
    motion = rig.motion
    stamps, index = np.unique(rig.streams["imu"].stamps, return_index=True)
    gyro = rig.imu.gyro[index]
    good = np.isfinite(gyro).all(axis=1)
    if good.sum() < align.LEAST_STEPS:
        report.unjudged("there are %d samples of the gyro" % good.sum())
        return False
    seconds = (motion.end - motion.begin)[:, None] * 1e-9
    rates = motion.rotation / seconds
    ordinary = _ordinary(rates)
    turning = float(np.sqrt(np.sum(np.var(rates[ordinary], axis=0))))
    needed = max(LEAST_RATE, NOISES * float(np.median(motion.rotation_sigma / seconds[:, 0])))
    a = align.align(motion, (stamps[good] - int(motion.begin[0])) * 1e-9, gyro[good])
    still = float(np.ptp(gyro[good], axis=0).max())
    if turning > 3.0 * needed and still < LEAST_RATE and (a is None or a.correlation < LEAST_CORRELATION):
        report.red("the gyro does not move while the camera turns", "%.2g rad/s from its least to its largest rate" % still,
                   "%.2g rad/s of the camera" % turning, "is the gyro alive, and on the same body?")
        return False
    if a is None or turning < needed:
        report.unjudged("the rig hardly turns (%.2g rad/s of the camera, %.2g are needed): turn it about all axes" % (turning, needed))
        return False
    report.draw("correlation of the rates over the offset of the clocks", _draw_offsets(a),
                "added to the camera's stamps, ms", "correlation")
    if a.correlation < LEAST_CORRELATION:
        gyro_rate = float(np.sqrt(np.sum(a.gyro**2) / max(1, len(a.gyro))))
        if turning > 3.0 * needed and a.correlation < 0.5:
            report.red("gyro and camera do not turn together", "correlation %.2f" % a.correlation, "%g" % LEAST_CORRELATION,
                       "are they on one body? are the clocks off by more than %g s? is the gyro alive (%.2g rad/s)?" % (
                           align.MAX_OFFSET, gyro_rate))
        else:
            report.unjudged("rates fit too little (correlation %.2f, %g is needed): turn the rig faster, about all axes" % (
                a.correlation, LEAST_CORRELATION))
        return False
    rig.alignment = a
    return True


def _ordinary(rates):
    """(N,): which rates (N, 3) are no jumps of the camera's estimate."""
    norms = np.linalg.norm(rates, axis=1)
    return norms <= np.percentile(norms, 95.0)


def check_rotation(rig, report):
    """The extrinsic's rotation."""
    a = rig.alignment
    if a is None or rig.cam_T_imu is None:
        report.unjudged("it needs a rig that turns, and the transform")
        return
    stated = rig.cam_T_imu[:3, :3]
    found = align.misalignment(a, stated)
    report.draw("rates about the camera's axes without their means: camera (points), gyro by the stated rotation (lines)", _draw_rates(a, stated),
                "s", "rad/s")
    angle, known = np.degrees(found.angle), np.degrees(found.known)
    figure = "known to %.2f deg about the worst axis" % known
    limit = "%.1f deg" % np.degrees(ANGLE_YELLOW)
    # `sure` leaves out what noise explains; errors of the points last, and make more than white noise would.
    if found.sure < ANGLE_YELLOW and align.SIGMAS * found.known > ANGLE_RED:
        report.unjudged("about one axis the rotation is known to %.3g deg only, %.1f are needed; about the others it fits: turn the rig about "
                        "all axes" % (known, np.degrees(ANGLE_RED) / align.SIGMAS))
        return
    if found.sure < ANGLE_YELLOW:
        report.green("the rotation from the IMU to the camera", "%.2f deg off, %s" % (angle, figure), limit)
        return
    # Of the camera as it is mounted, before it is rectified; a child's pose, as /tf has it.
    imu_R_left = found.rotation.T @ Camera(rig.infos["left"]).R
    command = "rosrun tf2_ros static_transform_publisher X Y Z %.4f %.4f %.4f %.4f %s %s" % (
        tuple(rotation_to_quaternion(imu_R_left)) + (rig.streams["imu"].frame_id, rig.infos["left"].header.frame_id.lstrip("/")))
    reason = align.explain(a, stated, ANGLE_RED) if found.angle > 3.0 * ANGLE_RED else ""
    report.complain(found.sure > ANGLE_RED,
                    "imu -> camera is off by %.3g deg%s" % (angle, ": " + reason if reason else ""), figure, limit,
                    "the rotation was measured: %s (X Y Z: where the camera is on the IMU, m)" % command)


def check_offset(rig, report):
    """The camera's clock against the gyro's."""
    a = rig.alignment
    if a is None:
        report.unjudged("it needs a rig that turns")
        return
    # A sample of the IMU may stand for the time before or after its stamp.
    noise = align.SIGMAS * a.offset_sigma
    unsure = noise + 1e-9 * float(np.median(np.diff(np.unique(rig.streams["imu"].stamps))))
    focal = rig.cameras[0].P[0, 0]
    fast = float(np.percentile(np.linalg.norm(a.camera, axis=1), 95.0))
    pixels = abs(a.offset) * fast * focal
    figure = "%+.1f ms +- %.1f, which is %.1f px when turning by %.2g rad/s" % (1e3 * a.offset, 1e3 * unsure, pixels, fast)
    limit = "%g px, or 5 sigma and the IMU's period" % PIXELS_YELLOW
    if abs(a.offset) < unsure or pixels < PIXELS_YELLOW:
        if max(abs(a.offset), noise) * fast * focal > PIXELS_RED:
            report.unjudged("%s: turn the rig faster, with an IMU of a higher rate" % figure)
            return
        report.green("the clocks of camera and IMU agree", figure, limit)
        return
    if abs(a.offset) > 0.98 * align.MAX_OFFSET:
        report.red("the clocks of camera and IMU do not agree", "by more than %g s" % align.MAX_OFFSET, limit, "see how both are stamped")
        return
    report.complain(pixels > PIXELS_RED, "the camera's stamps are %.0f ms %s" % (
        1e3 * abs(a.offset), "late" if a.offset < 0.0 else "early"), figure, limit,
        "calibration/time_offset: %.4f, with time_offset_sigma: %.4f; better: stamp at the middle of the exposure" % (
            a.offset, max(0.002, 3.0 * a.offset_sigma)))


def check_bias(rig, report):
    """The gyro's, by the camera."""
    a = rig.alignment
    if a is None or rig.cam_T_imu is None:
        report.unjudged("it needs a rig that turns, and the transform")
        return
    stamps, index = np.unique(rig.streams["imu"].stamps, return_index=True)
    motion, origin = rig.motion, int(rig.motion.begin[0])
    begin, end = ((x[a.index] - origin) * 1e-9 + a.offset for x in (motion.begin, motion.end))
    gyro = align.mean_rate((stamps - origin) * 1e-9, rig.imu.gyro[index], begin, end)
    camera = motion.rotation[a.index] / (end - begin)[:, None]
    bias = np.nanmedian(gyro - camera @ rig.cam_T_imu[:3, :3], axis=0)
    rig.gyro_bias = bias
    worst, limit = float(np.abs(bias).max()), 3.0 * BIAS_SIGMAS[0]
    figure = "(%.4f, %.4f, %.4f) rad/s" % tuple(bias)
    if worst > limit:
        report.yellow("the gyro's bias is large", figure, "%.2g rad/s, 3 times inertial/imu_bias_sigma" % limit,
                      "calibrate the gyro at rest, or raise inertial/imu_bias_sigma")
    else:
        report.green("the gyro's bias", figure, "%.2g rad/s" % limit)


def _draw_offsets(a):
    def draw(axes):
        axes.plot(1e3 * a.correlations[0], a.correlations[1])
        axes.axvline(1e3 * a.offset, color="C3", linewidth=0.8)
    return draw


def _draw_rates(a, stated):
    def draw(axes):
        predicted = np.sqrt(a.scale[0] * a.scale[1]) * a.gyro @ stated.T
        for k, name in enumerate("xyz"):
            axes.plot(a.times, a.camera[:, k], ".", markersize=3, color="C%d" % k)
            axes.plot(a.times, predicted[:, k], linewidth=0.8, color="C%d" % k, label=name)
    return draw
