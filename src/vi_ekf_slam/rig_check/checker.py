"""Command line of check_rig.py: the checks in their order, and what rests on what."""

import argparse
import os
import sys
import tempfile
from collections import namedtuple

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output, make_directory, write_text
from vi_ekf_slam.common.stop_signals import signals_unwind
from vi_ekf_slam.rig_check.finding import RED, Report

EXIT_RED = 1
DEFAULT_DURATION = 60.0  # s

Check = namedtuple("Check", "name function needs")


def all_checks():
    """The most basic first; `needs`: checks without which what one finds only follows from them."""
    from vi_ekf_slam.rig_check import calibration, imu_units, inputs, load, moment, pictures, rotation, scale, stereo, timing
    times = ("topics", "stamps", "clocks")
    known = times + ("repeats", "numbers", "pairs", "camera_info", "pictures")
    seen = known + ("one moment", "stereo")
    turns = seen + ("rates", "gyro")
    return (
        Check("topics", inputs.check_inputs, ()),
        Check("numbers", inputs.check_numbers, ()),
        Check("stamps", timing.check_stamps, ()),
        Check("repeats", timing.check_repeats, ("stamps",)),
        Check("clocks", timing.check_clocks, ("stamps",)),
        Check("rates", timing.check_rates, ("stamps",)),
        Check("accelerometer", imu_units.check_accelerometer, ("numbers",)),
        Check("camera_info", calibration.check_calibration, ()),
        Check("transform", calibration.check_extrinsic, ()),
        Check("pairs", timing.check_pairs, ("stamps", "clocks")),
        Check("pictures", pictures.check_pictures, ("pairs",)),
        Check("one moment", moment.check_moment, known),
        Check("stereo", stereo.check_stereo, ("numbers", "camera_info", "pairs", "pictures", "one moment")),
        Check("gyro", rotation.check_gyro, seen + ("rates",)),
        Check("rotation", rotation.check_rotation, turns + ("transform",)),
        Check("time offset", rotation.check_offset, turns),
        Check("accelerometer sign", imu_units.check_up, ("accelerometer", "transform", "rotation")),
        Check("gyro bias", rotation.check_bias, turns + ("transform", "rotation", "time offset")),
        Check("scale", scale.check_scale, turns + ("transform", "rotation", "time offset", "accelerometer")),
        Check("noise", imu_units.check_noise, ("stamps", "numbers", "rates", "gyro", "accelerometer")),
        Check("load", load.check_load, turns + ("transform", "rotation")),
    )


def make_report(path, name, options):
    """Report of a bag. options: remap, duration, imu_noise, without_load."""
    from vi_ekf_slam.bag.topics import parse_remappings
    from vi_ekf_slam.rig_check.rig import Rig
    rig = Rig(path, parse_remappings(options.remap), options.duration)
    rig.noise, rig.noise_path = _noise(options.imu_noise)
    report = Report(name)
    for check in all_checks():
        if check.name == "load" and options.without_load:
            continue
        if report.begin(check.name, check.needs):
            check.function(rig, report)
    return report


def _noise(path):
    if path is None:
        return None, ""
    from vi_ekf_slam.recordings.rig_calibration import read_noise
    return read_noise(path), os.path.basename(path)


def make_parser():
    """The argument parser, with every option's unit and default."""
    parser = argparse.ArgumentParser(
        prog="check_rig.py", usage="check_rig.py BAG [NAME:=TOPIC ...] [options]\n       check_rig.py --live SECONDS [NAME:=TOPIC ...] [options]",
        description="What is wrong with a rig of stereo camera and IMU, and what to do: topics, stamps, units, calibration, clocks, pictures. "
                    "The most basic fault comes first; what only follows from it is not judged. The recording should begin at rest and then "
                    "turn about all axes.",
        epilog="Topics are those of slam.launch: NAME is imu, velocity, wheel_odometry, features, left_image, right_image, left_info or "
               "right_info. Ends with 0 where nothing is red, with 1 where something is, with 2 where the input cannot be read.")
    parser.add_argument("words", metavar="BAG, NAME:=TOPIC", nargs="*", help="recording, and topics that have other names")
    parser.add_argument("--live", type=float, metavar="SECONDS", help="s; listen to the topics that are published now instead of a bag")
    parser.add_argument("--duration", type=float, default=DEFAULT_DURATION, metavar="S",
                        help="s of the bag that are looked at, from its beginning; 0: all (default: %(default)g)")
    parser.add_argument("--imu-noise", metavar="FILE", help="what noise is stated: Kalibr's imu.yaml or EuRoC's sensor.yaml (default: the "
                                                            "messages' covariances)")
    parser.add_argument("--html", metavar="OUT.html", help="write the report with pictures as one file")
    parser.add_argument("--output", metavar="DIR", help="write DIR/rig.html and DIR/rig.txt; the directory is made")
    parser.add_argument("--without-load", action="store_true", help="do not time the estimator on this machine")
    parser.add_argument("--quiet", action="store_true", help="print the verdict alone")
    return parser


def check(options):
    """Do what the parsed options ask; returns the Report. InputError when something is refused."""
    bags = [word for word in options.words if ":=" not in word]
    options.remap = [word for word in options.words if ":=" in word]
    if len(bags) != (0 if options.live is not None else 1):
        raise InputError("%d bags are given, allowed: one, or none with --live" % len(bags))
    if not 0.0 <= options.duration < 1e9:
        raise InputError("--duration is %g, allowed: s, not negative; 0: all" % options.duration)
    if options.html:
        check_output(options.html, bags[0] if bags else None)
    if options.live is not None:
        checks.require_positive(options.live, "--live", "s")
        from vi_ekf_slam.rig_check.live import record
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "live.bag")
            record(path, options)
            options.duration = 0.0
            report = make_report(path, "live, %g s" % options.live, options)
            _write(report, options)
    else:
        report = make_report(bags[0], os.path.basename(bags[0]), options)
        _write(report, options)
    return report


def _write(report, options):
    from vi_ekf_slam.rig_check import output
    print(output.verdict(report) if options.quiet else output.text(report, sys.stdout.isatty()), flush=True)
    if options.html:
        write_text(options.html, output.page(report))
    if options.output:
        make_directory(options.output)
        write_text(os.path.join(options.output, "rig.html"), output.page(report))
        write_text(os.path.join(options.output, "rig.txt"), output.text(report) + "\n")


def main(argv=None):
    """Entry point: 0 where nothing is red, 1 where something is, 2 and one line on stderr when the input is refused."""
    options = make_parser().parse_intermixed_args(argv)
    found = []
    with signals_unwind():
        status = exit_status(lambda: found.append(check(options)), source=" ".join(options.words))
    return status or (EXIT_RED if found[0].of_level(RED) else 0)
