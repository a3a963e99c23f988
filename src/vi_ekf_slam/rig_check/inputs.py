"""Is there all that the node needs, and is each number a number?"""

import numpy as np

from vi_ekf_slam.bag import topics as names

# What a MEMS gyro or accelerometer can say at all: 4000 deg/s and 200 g are beyond the ranges of those that are sold.
MAX_RATE, MAX_ACCELERATION = 70.0, 2000.0  # rad/s, m/s^2
MAX_SIGMA = 50.0  # px: a point that is known no better is none
DEGREES = 180.0 / np.pi


def check_inputs(rig, report):
    """Topics: what is required depends on what there is (an accelerometer does without a velocity, a camera without either)."""
    missing = _missing(rig)
    for name in missing:
        kinds = names.TYPES[name]
        others = sorted(topic for topic, kind in rig.present.items() if kind in kinds)
        advice = "name the topic: " + " or ".join(names.argument(name, topic) for topic in others) if others else \
            "no topic of type %s is there: start the driver, and record it" % " or ".join(kinds)
        if name == "left_image":
            advice += "; or features"
        report.red("nothing comes on %s" % names.DEFAULTS[name], "0 messages", "required", advice)
    for name, topic in sorted(rig.guessed.items()):
        report.yellow("%s is taken from %s" % (names.DEFAULTS[name], topic), topic, names.DEFAULTS[name],
                      "give slam.launch %s" % names.argument(name, topic))
    if not missing:
        report.green("all required topics are there", ", ".join(rig.topics[name] for name in sorted(rig.streams)), "")


def _missing(rig):
    has = rig.streams
    missing = []
    camera = "features" in has or ("left_image" in has and "right_image" in has)
    # Of several IMUs, of which nobody named one, one is meant.
    several = "imu" not in rig.given and any(kind in names.TYPES["imu"] for kind in rig.present.values())
    alone = camera and "imu" not in has and rig.velocity is None and not several
    if "imu" not in has and not alone:
        missing.append("imu")
    if not camera:
        missing += [name for name in ("left_image", "right_image") if name not in has]
    missing += [name for name in ("left_info", "right_info") if name not in has]
    if "imu" in has and rig.velocity is None and not rig.has_acceleration:
        missing.append("velocity")
    return missing


def check_numbers(rig, report):
    """NaN, infinity, and what no sensor says."""
    parts = []
    if rig.imu is not None:
        parts.append(("imu", "angular_velocity", rig.imu.gyro, MAX_RATE, "rad/s"))
        parts.append(("imu", "linear_acceleration", rig.imu.acceleration, MAX_ACCELERATION, "m/s^2"))
    if rig.velocity is not None:
        parts.append((rig.velocity_name, "twist.linear", rig.velocity, 200.0, "m/s"))
    has_features = any(len(ids) for ids, _ in rig.frames)
    if has_features:
        parts.append(("features", "a pixel", np.concatenate([pixels for _, pixels in rig.frames]), 1e5, "px"))
    before = len(report.findings)
    for name, field, values, limit, unit in parts:
        bad = ~np.isfinite(values).all(axis=1)
        where = "%s of %s" % (field, rig.topics[name])
        if bad.any():
            report.complain(bad.mean() > 0.01, "%s is NaN or infinite" % where,
                            "%d of %d (%.3g %%)" % (bad.sum(), len(bad), 100.0 * bad.mean()), "none",
                            "such messages are dropped: see why the driver sends them")
        beyond = np.abs(np.where(np.isfinite(values), values, 0.0)).max(axis=1, initial=0.0) > limit
        if beyond.mean() > 0.01:
            largest = np.abs(values[np.isfinite(values).all(axis=1)]).max()
            is_in_degrees = field == "angular_velocity" and largest <= DEGREES * limit
            report.red("the gyro is in deg/s" if is_in_degrees else "%s is beyond what any sensor says" % where,
                       "up to %.4g %s" % (largest, unit), "%g %s" % (limit, unit),
                       "it must be in rad/s: multiply by pi / 180" if is_in_degrees else
                       "see which unit the driver uses; SI units are required")
    if has_features:
        _check_features(rig, report)
    if len(report.findings) == before:
        report.green("all numbers are finite and possible")


def _check_features(rig, report):
    """What features state: ids that one frame has twice, sigma."""
    topic, sigmas = rig.topics["features"], np.concatenate(rig.feature_sigmas)
    lost = ~(sigmas >= 0.0) | np.isinf(sigmas)
    beyond = ~lost & (sigmas > MAX_SIGMA)
    repeated = np.array([len(ids) - len(np.unique(ids)) for ids, _ in rig.frames])
    for bad, text, figure, limit, advice in (
            (lost, "sigma of %s is negative, NaN or infinite" % topic, "%d of %d points" % (lost.sum(), len(lost)), "0 px and above",
             "such points are dropped: state the noise in px, 0 where it is not known"),
            (beyond, "sigma of %s is beyond what any point has" % topic, "%d of %d points, up to %.4g px" % (
                beyond.sum(), len(beyond), sigmas[~lost].max(initial=0.0)), "%g px" % MAX_SIGMA,
             "state the noise of a coordinate in px, 0 where it is not known"),
            (repeated > 0, "ids repeat within a message of %s" % topic, "%d points in %d of %d messages" % (
                repeated.sum(), (repeated > 0).sum(), len(repeated)), "none",
             "of points with one id all but the first are dropped: give each point an id of its own")):
        if bad.any():
            report.complain(bad.mean() > 0.01, text, figure, limit, advice)
