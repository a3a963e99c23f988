"""Stamps: of each stream by itself, against the time of receipt, and of one stream against another."""

import numpy as np

NANO = 1e-9
FACTOR = 1.5  # an interval that differs by more from the median is odd, as the node counts it (sensors/imu_check.cpp)
STUTTER = 0.1  # share of odd intervals from which the node says that the IMU stutters
MAX_DELAY = 0.2  # s, buffer/max_delay_s: what comes later after the newest stamp is dropped
MAX_GAP = 30.0  # s, buffer/max_gap_s: a longer gap is a new start
# s, and mean intervals, beyond which a gap of the IMU counts as unknown motion (sensors/imu_track.cpp); a few short ones do no harm.
IMU_GAP, IMU_MISSING = 0.15, 4.0
FEW_LOST = 0.01  # of the time
FRAME_GAP = 0.5  # s over which the front end bridges tracks (front_end.cpp)
FEWEST = 20  # messages that tell a rate
# Hz that accuracy and consistency are tested at (docs/accuracy.md): frames 5 to 30, IMU 10 to 400 with a velocity; an
# accelerometer is integrated twice between two samples, at 100 and more.
LOW_RATE = {"imu": 100.0, "left_image": 5.0, "features": 5.0, "right_image": 5.0}
# s: what is sent again sooner shows no camera that has come to rest (front_end.cpp, kLeastRest), as a simulator's without noise is seen to.
LEAST_REST = 0.2
SENT_TWICE = (0.05, 0.2)  # share of the messages; a simulator that stops now and then makes less
DRIFT_PPM = (100.0, 1000.0)  # of two clocks: crystals keep 50 each; beyond 1000 a minute makes 60 ms


def check_stamps(rig, report):
    """Zero, back, repeated."""
    before = len(report.findings)
    for name, stream in sorted(rig.streams.items()):
        stamps = stream.stamps
        zero = stamps <= 0
        if zero.any():
            report.red("header.stamp of %s is zero" % stream.topic, "%d of %d" % (zero.sum(), len(stamps)), "none",
                       "the driver must stamp each message with the time of measurement")
            continue
        if name.endswith("info"):
            continue
        steps = np.diff(stamps) * NANO
        behind = (np.maximum.accumulate(stamps)[:-1] - stamps[1:]) * NANO
        back, repeated = behind > 0.0, steps == 0.0
        if back.any():
            worst = behind.max()
            report.complain(worst > MAX_DELAY or back.mean() > STUTTER, "time runs back on %s" % stream.topic,
                            "%d times, by up to %.3g s" % (back.sum(), worst), "%g s (buffer/max_delay_s)" % MAX_DELAY,
                            "was the clock set while recording, does the bag loop, or do two drivers publish on it?")
        if repeated.any():
            report.complain(repeated.mean() > 0.01, "stamps repeat on %s" % stream.topic,
                            "%d of %d (%.3g %%)" % (repeated.sum(), len(steps), 100.0 * repeated.mean()), "none",
                            "the second of two equal stamps is dropped: does the driver stamp by a coarse clock, or do "
                            "two publish on it?")
    if len(report.findings) == before:
        report.green("stamps are there and rise")


def check_repeats(rig, report):
    """Pictures and features that are sent twice, with two stamps: of the second the stamp is wrong."""
    before = len(report.findings)
    for name, repeats in sorted(rig.repeats.items()):
        if name not in rig.streams:
            continue
        stream = rig.streams[name]
        since = np.maximum.accumulate(np.where(repeats, 0, np.arange(len(repeats))))  # which message said it first
        age = (stream.stamps - stream.stamps[since]) * NANO
        share = float(np.mean(repeats & (age > 0.0) & (age < LEAST_REST)))
        if share > SENT_TWICE[0]:
            report.complain(share > SENT_TWICE[1], "%s repeats what it has sent, with a new stamp" % stream.topic,
                            "%.0f %% of %d messages" % (100.0 * share, len(repeats)), "%g %%" % (100.0 * SENT_TWICE[0]),
                            "each picture is to be sent once, with the time of its exposure: does the driver, or a "
                            "node that throttles or relays, send at a higher rate than the camera's?")
    if len(report.findings) == before and any(name in rig.streams for name in rig.repeats):
        report.green("pictures and features are sent once")


def check_clocks(rig, report):
    """Streams against each other: one clock, and stamps against receipt."""
    main = [rig.streams[name] for name in ("imu", rig.velocity_name, rig.frame_name) if name in rig.streams]
    before = len(report.findings)
    for other in main[1:]:
        overlap = min(other.stamps.max(), main[0].stamps.max()) - max(other.stamps.min(), main[0].stamps.min())
        shorter = min(np.ptp(other.stamps), np.ptp(main[0].stamps))
        if overlap < 0.5 * shorter:
            offset = (other.stamps.min() - main[0].stamps.min()) * NANO
            report.red("%s and %s have two clocks" % (main[0].topic, other.topic), "%.6g s apart" % offset,
                       "stamps of the same time", "make both drivers stamp by one clock (host time, PTP, hardware synchronisation)")
    if len(report.findings) == before:
        _check_receipt(rig, main, report)
    if len(report.findings) == before:
        report.green("all streams have one clock", "", "within %g s" % MAX_DELAY)


def _check_receipt(rig, main, report):
    delays = [(stream, (stream.received - stream.stamps) * NANO) for stream in main if len(stream.stamps) >= FEWEST]
    if len(delays) < 2 or all(np.abs(delay).max() < 1e-6 for _, delay in delays):
        return  # a bag that was made of a data set: each message is received at its stamp
    quick = [np.percentile(delay, 5.0) for _, delay in delays]
    report.draw("receipt after the stamp, s", _draw_delays(rig, delays, float(np.median(quick))), "stamp, s", "s")
    for (stream, delay), least in zip(delays[1:], quick[1:]):
        behind, topics = least - quick[0], (delays[0][0].topic, stream.topic)
        if abs(behind) > MAX_DELAY:
            report.red("%s comes %.3g s %s after its stamp than %s" % (topics[1], abs(behind), "later" if behind > 0 else "earlier",
                                                                       topics[0]),
                       "%.3g s" % behind, "within %g s (buffer/max_delay_s)" % MAX_DELAY,
                       "one of the two has another clock, or waits somewhere; stamps must be the time of measurement in one clock")
        drift = 1e6 * (_slope(stream, delay) - _slope(*delays[0]))
        if abs(drift) > DRIFT_PPM[0]:
            report.complain(abs(drift) > DRIFT_PPM[1], "the clocks of %s and %s drift apart" % topics,
                            "%.0f ppm" % drift, "%g ppm" % DRIFT_PPM[0],
                            "stamp both by one clock; a camera's own must be synchronised to the host's")


def _slope(stream, delay):
    """s/s, of the least delays of ten parts: what waits in a queue only adds. 0 where the recording is too short to tell."""
    t = (stream.stamps - stream.stamps[0]) * NANO
    if t[-1] < 10.0 or len(t) < 100:
        return 0.0
    lowest = [part[np.argmin(delay[part])] for part in np.array_split(np.arange(len(t)), 10)]
    slopes = [(delay[b] - delay[a]) / (t[b] - t[a]) for i, a in enumerate(lowest) for b in lowest[i + 1:] if t[b] > t[a]]
    return float(np.median(slopes)) if slopes else 0.0


def _draw_delays(rig, delays, middle):
    def draw(axes):
        for stream, delay in delays:
            axes.plot(rig.seconds(stream.stamps), delay, ".", markersize=2, label=stream.topic)
        axes.axhline(middle, color="0.7", linewidth=0.5)
    return draw


def check_rates(rig, report):
    """Rate, stutter, gaps of each stream."""
    for name, stream in sorted(rig.streams.items()):
        if name.endswith("info"):
            continue
        stamps = np.unique(stream.stamps)
        if len(stamps) < FEWEST:
            report.red("hardly anything comes on %s" % stream.topic, "%d messages" % len(stamps), "%d" % FEWEST,
                       "record longer, and see what the driver sends")
            continue
        steps = np.diff(stamps) * NANO
        usual = float(np.median(steps))
        report.draw("%s: time between two stamps, ms" % stream.topic, _draw_steps(rig, stamps, steps), "stamp, s", "ms")
        _check_rate(rig, name, stream, steps, usual, report)


def _check_rate(rig, name, stream, steps, usual, report):
    rate = 1.0 / usual
    longest = max(IMU_GAP if name == "imu" else FRAME_GAP, 5.0 * usual)
    limit = max(min(longest, IMU_MISSING * steps.mean()), 5.0 * usual) if name == "imu" else longest
    gaps = steps > limit
    odd = (steps > FACTOR * usual) | (FACTOR * steps < usual)
    lost = steps[gaps].sum() / steps.sum()
    figure = "%.4g Hz, %.2g ms of jitter (RMS)" % (rate, round(1e3 * np.std(steps[~odd]), 4) if (~odd).any() else 0.0)
    before = len(report.findings)
    if lost > FEW_LOST or steps.max() > longest:
        report.complain(lost > 0.1 or steps.max() > MAX_GAP, "%s has gaps" % stream.topic,
                        "%d, the longest %.3g s, %.3g %% of the time" % (gaps.sum(), steps.max(), 100.0 * lost),
                        "%.2g s" % limit, "messages are lost: is the disk, the USB port or a queue too slow? look at "
                        "`rostopic hz` with nothing else running")
    if odd.mean() > STUTTER:
        report.yellow("%s stutters: one interval in %.0f is not the usual one" % (stream.topic, 1.0 / odd.mean()),
                      "%.3g to %.3g ms, mostly %.3g" % (1e3 * steps.min(), 1e3 * steps.max(), 1e3 * usual),
                      "one in %.0f off by a factor of %g" % (1.0 / STUTTER, FACTOR),
                      "is it stamped on arrival instead of at the measurement? use the sensor's own time")
    low = LOW_RATE.get(name, 0.0) if name != "imu" or rig.has_acceleration else 0.0
    if rate < 0.95 * low:
        report.yellow("%s is slow" % stream.topic, figure, "%g Hz" % low, "set the driver to a higher rate")
    if len(report.findings) == before:
        report.green("%s: rate and gaps" % stream.topic, figure, "gaps up to %.2g s" % limit)


def _draw_steps(rig, stamps, steps):
    def draw(axes):
        axes.plot(rig.seconds(stamps[1:]), 1e3 * steps, ".", markersize=2)
        axes.set_yscale("log")
    return draw


def check_pairs(rig, report):
    """Left and right pictures of one time."""
    from vi_ekf_slam.recordings.stamp_pairs import PAIR_TOLERANCE, pair_stamps
    if "left_image" not in rig.streams or "right_image" not in rig.streams:
        report.unjudged("there are no pictures of both cameras")
        return
    left, right = rig.streams["left_image"], rig.streams["right_image"]
    rig.pairs = pair_stamps(left.stamps, right.stamps)
    begin, end = max(left.stamps.min(), right.stamps.min()), min(left.stamps.max(), right.stamps.max())
    within = (left.stamps >= begin - PAIR_TOLERANCE) & (left.stamps <= end + PAIR_TOLERANCE)
    share = len(rig.pairs) / max(1, within.sum())
    if share < 0.95:
        nearest = np.abs(right.stamps[None, :] - left.stamps[within][:200, None]).min(axis=1) if within.any() else np.zeros(1)
        figure = "%.0f %% of the left ones have a right one; the nearest is %.3g ms off in the median" % (
            100.0 * share, 1e-6 * np.median(nearest))
        report.complain(share < 0.5, "left and right pictures are not pairs", figure,
                        "%g ms (front_end/pair_tolerance_s)" % (1e-6 * PAIR_TOLERANCE),
                        "trigger both cameras together, and give both pictures the same stamp")
        return
    offset = right.stamps[rig.pairs[:, 1]] - left.stamps[rig.pairs[:, 0]]
    report.green("left and right pictures are pairs", "%.4g %%, stamps differ by %.2g ms (median)" % (
        100.0 * min(1.0, share), 1e-6 * np.median(np.abs(offset))), "%g ms" % (1e-6 * PAIR_TOLERANCE))
