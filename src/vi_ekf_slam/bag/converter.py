"""Command line of dataset_to_bag.py."""

import argparse

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output
from vi_ekf_slam.common.stop_signals import signals_unwind
from vi_ekf_slam.dataset.as_recording import as_recording
from vi_ekf_slam.dataset.extrinsic import READINGS
from vi_ekf_slam.dataset.loader import DEFAULT_MAX_MEMORY_MB, load_dataset
from vi_ekf_slam.dataset.stale import assign_ids
from vi_ekf_slam.dataset.summary import summarise
from vi_ekf_slam.dataset.truth import BODIES, load_truth
from vi_ekf_slam.recordings.formats import load_recording
from vi_ekf_slam.recordings.summary import summarise_recording

DEFAULT_VELOCITY_SIGMA = 0.5  # m/s
DEFAULT_GYRO_SIGMA = 0.05  # rad/s
VELOCITY_BIAS_SIGMA = 0.001  # m/s
NOISY_GYRO_BIAS_SIGMA = 0.01  # rad/s, of what was added to the course's drives
INS_GYRO_BIAS_SIGMA = 0.0003  # rad/s, 1 deg/min: what an inertial navigation system leaves at most
# m/s, rad/s: better than any sensor, and what a twist may be at most (loader.MAX_SPEED). Messages hold the square, a number
# above 0.
SIGMA_LIMITS = 1e-12, 1e3


def make_parser():
    """The argument parser, with every option's unit and default."""
    parser = argparse.ArgumentParser(
        prog="dataset_to_bag.py",
        description="Convert a drive to a bag. IN, whose format is found out: an .npz with stereo features, gyro and velocity, "
                    "or with an accelerometer; a folder of EuRoC or TUM-VI (mav0), a raw drive or an odometry sequence of "
                    "KITTI. Topics: /imu, /velocity, /features or /left/image/compressed and /right/image/compressed, "
                    "/left/camera_info, /right/camera_info, /tf_static and the truth. Beside OUT.bag, where the drive has "
                    "them: OUT.imu.yaml, the IMU's noise, and OUT.initial_state.yaml, a state to start from.")
    parser.add_argument("input", metavar="IN")
    parser.add_argument("output", metavar="OUT.bag", nargs="?", help="not needed with --info")
    parser.add_argument("--info", action="store_true", help="print a summary of the dataset and write nothing")
    parser.add_argument("--without-features", action="store_true", help="convert IMU and velocity alone")
    parser.add_argument("--keep-stale", action="store_true",
                        help="keep ids over frames that repeat the last frame's pixels (default: tracks end there)")
    parser.add_argument("--extrinsic", choices=READINGS, default="repaired",
                        help="how to read the key cam_T_imu, whose translation files give as the camera's position in "
                             "IMU axes (default: %(default)s)")
    parser.add_argument("--velocity-sigma", type=float, default=DEFAULT_VELOCITY_SIGMA, metavar="M/S",
                        help="standard deviation of the velocity per axis (default: %(default)s)")
    parser.add_argument("--gyro-sigma", type=float, metavar="RAD/S",
                        help="standard deviation of the gyro per axis (default: %g)" % DEFAULT_GYRO_SIGMA)
    add_bias_options(parser)
    add_folder_options(parser)
    parser.add_argument("--truth", metavar="FILE",
                        help="true poses, KITTI (12 columns) or TUM (8 columns), recorded as /ground_truth/path and "
                             "/ground_truth/pose: IMU poses that begin at the identity of the frame map")
    parser.add_argument("--truth-body", choices=BODIES,
                        help="whose poses they are (default: left_camera for KITTI, imu for TUM)")
    parser.add_argument("--max-memory-mb", type=float, default=DEFAULT_MAX_MEMORY_MB, metavar="MB",
                        help="refuse files whose arrays are larger than this as 64-bit floats; conversion needs about "
                             "twice as much at its peak (default: %(default)g)")
    parser.add_argument("--quiet", action="store_true", help="no report and no progress bar")
    return parser


def add_folder_options(parser):
    """For drives that are folders."""
    parser.add_argument("--velocity", action="store_true",
                        help="of a raw drive of KITTI: the velocity of oxts too, as /velocity")
    parser.add_argument("--calibration", metavar="PATH",
                        help="of a folder: Kalibr's camchain (EuRoC, TUM-VI), or the folder with KITTI's calibration (default: "
                             "what lies in the drive's folder)")
    parser.add_argument("--skip-bad", action="store_true",
                        help="leave out files that are missing, damaged or too many, and rows whose stamps do not increase, and say "
                             "which; else they are errors")


def add_bias_options(parser):
    """What is known of the constant biases, recorded as /twist_bias."""
    parser.add_argument("--velocity-bias-sigma", type=float, default=VELOCITY_BIAS_SIGMA, metavar="M/S",
                        help="standard deviation of the velocity's constant bias (default: %(default)s)")
    parser.add_argument("--gyro-bias-sigma", type=float, metavar="RAD/S",
                        help="standard deviation of the gyro's constant bias (default: %g, as it was added to the "
                             "noisy .npz drives of KITTI; %g where the twist is an INS's as it was recorded, whose noise only "
                             "--gyro-sigma says)" % (NOISY_GYRO_BIAS_SIGMA, INS_GYRO_BIAS_SIGMA))


def check_sigmas(options):
    """InputError unless all of them are positive and within SIGMA_LIMITS."""
    for name, unit in (("velocity_sigma", "m/s"), ("gyro_sigma", "rad/s"), ("velocity_bias_sigma", "m/s"),
                       ("gyro_bias_sigma", "rad/s")):
        sigma, option = getattr(options, name), "--" + name.replace("_", "-")
        if sigma is not None and not SIGMA_LIMITS[0] <= checks.require_positive(sigma, option, unit) <= SIGMA_LIMITS[1]:
            raise InputError("%s is %g %s, allowed: from %g to %g" % (option, sigma, unit, *SIGMA_LIMITS))


def convert(options):
    """Do what the parsed options ask; InputError when something is refused."""
    check_sigmas(options)
    checks.require_positive(options.max_memory_mb, "--max-memory-mb", "MB")
    if options.truth_body and not options.truth:
        raise InputError("--truth-body needs --truth")
    if not options.info:
        if options.output is None:
            raise InputError("OUT.bag is missing; only --info works without it")
        # A glob that matches a second drive must not have it replaced.
        check_output(options.output, options.input, ".bag", "OUT.bag")
        _bag_writer()  # complain before the work, not after it

    recording = load_recording(options, vars(make_parser().parse_args(["--", options.input])))
    recording, report = _from_dataset(options) if recording is None else (recording, summarise_recording(recording))
    if not options.quiet or options.info:
        print("\n".join(report), flush=True)
    if options.info:
        return
    writer = _bag_writer()
    side_files = writer.side_files(recording, options.output)
    for path in side_files:
        check_output(path, options.input)
    count = writer.record(recording, options.output, options.quiet)
    if not options.quiet:
        print("wrote: %s, %d messages" % (options.output, count))
        print("".join("wrote: %s\n" % path for path in side_files), end="")


def _from_dataset(options):
    """(Recording, report as lines) of an .npz with a velocity."""
    if options.gyro_bias_sigma is None:
        options.gyro_bias_sigma = NOISY_GYRO_BIAS_SIGMA if options.gyro_sigma is None else INS_GYRO_BIAS_SIGMA
    if options.gyro_sigma is None:
        options.gyro_sigma = DEFAULT_GYRO_SIGMA
    dataset = load_dataset(options.input, options.extrinsic, options.without_features, options.max_memory_mb)
    repair = truth = None
    if dataset.features is not None:
        repair = assign_ids(dataset.features, dataset.seen, repair=not options.keep_stale)
    if options.truth:
        truth = load_truth(options.truth, dataset.stamps, dataset.cam_T_imu, options.truth_body)
    report = summarise(dataset, repair, not options.keep_stale)
    if truth:
        report.append("truth: %d poses" % len(truth[0]))
    return as_recording(dataset, repair and repair.ids, truth, options), report


def _bag_writer():
    """The module that needs ROS, imported late: --info works without, and what is missing can be named."""
    try:
        from vi_ekf_slam.bag import writer
    except ImportError as reason:
        raise InputError("%s; source the workspace's setup.bash, and install rosbag and the Python halves of nav_msgs "
                         "and sensor_msgs (Debian: python3-rosbag python3-nav-msgs python3-sensor-msgs)" % reason)
    return writer


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused, 128 + n after signal n."""
    options = make_parser().parse_intermixed_args(argv)
    with signals_unwind():
        return exit_status(convert, options, source=options.input)
