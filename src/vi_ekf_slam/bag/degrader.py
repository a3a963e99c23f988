"""Command line of degraded_bag.py."""

import argparse

import numpy as np

from vi_ekf_slam.bag import converter
from vi_ekf_slam.bag.converter import DEFAULT_GYRO_SIGMA, DEFAULT_VELOCITY_SIGMA
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output
from vi_ekf_slam.dataset import degradation
from vi_ekf_slam.dataset.as_recording import as_recording
from vi_ekf_slam.dataset.loader import load_dataset
from vi_ekf_slam.dataset.stale import assign_ids
from vi_ekf_slam.dataset.synthetic_traffic import add_traffic
from vi_ekf_slam.dataset.truth import STAMP_TOLERANCE, load_truth, sample_poses

GOOD_VELOCITY_SIGMA = 0.1  # m/s
GOOD_GYRO_SIGMA = 0.01  # rad/s


def make_parser():
    """The argument parser, with every option's unit and default."""
    parser = argparse.ArgumentParser(
        prog="degraded_bag.py",
        description="Convert a drive (.npz) to a bag like dataset_to_bag.py (stale frames and extrinsic repaired) with "
                    "features taken away or traffic added, to see what an estimator makes of it. The bag ends where "
                    "the truth ends.")
    parser.add_argument("input", metavar="IN.npz")
    parser.add_argument("output", metavar="OUT.bag")
    parser.add_argument("--truth", metavar="FILE", required=True,
                        help="true poses of the left camera (KITTI) or of the IMU (TUM), recorded in the bag")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="keep every N-th track only")
    parser.add_argument("--longest", type=int, metavar="FRAMES", help="end each track after so many observations")
    parser.add_argument("--drop-last", type=float, default=0.0, metavar="SHARE",
                        help="take this share of each track's observations away at its end (default: %(default)s)")
    parser.add_argument("--blackout", type=float, nargs=2, metavar=("START", "DURATION"),
                        help="no features from START s after the first frame for DURATION s")
    parser.add_argument("--traffic", type=float, default=0.0, metavar="SHARE",
                        help="share of the features that ride on synthetic cars (default: %(default)s)")
    parser.add_argument("--good-twist", action="store_true",
                        help="replace gyro and velocity by the true ones plus white noise of the two sigmas below")
    parser.add_argument("--velocity-sigma", type=float, metavar="M/S",
                        help="standard deviation of the velocity per axis (default: %g, good twist %g)"
                             % (DEFAULT_VELOCITY_SIGMA, GOOD_VELOCITY_SIGMA))
    parser.add_argument("--gyro-sigma", type=float, metavar="RAD/S",
                        help="standard deviation of the gyro per axis (default: %g, good twist %g)"
                             % (DEFAULT_GYRO_SIGMA, GOOD_GYRO_SIGMA))
    converter.add_bias_options(parser)
    parser.add_argument("--seed", type=int, default=1, help="of everything random (default: %(default)s)")
    parser.add_argument("--quiet", action="store_true", help="no report and no progress bar")
    return parser


def load_drive(path, truth_path):
    """(dataset, ids, truth) of a drive as it is, cut to where its truth ends.

    The truth is at the frames' own stamps where it reaches all of them, else as it is in the file.
    """
    dataset = load_dataset(path)
    ids = assign_ids(dataset.features, dataset.seen).ids
    truth = load_truth(truth_path, dataset.stamps, dataset.cam_T_imu)
    frames = int(np.sum(dataset.stamps <= truth[0][-1] + STAMP_TOLERANCE))
    dataset, ids = degradation.cut_to(dataset, ids, frames)
    reached, poses = sample_poses(*truth, dataset.stamps)
    return dataset, ids, (dataset.stamps, poses) if reached.all() else truth


def degraded(options, drive):
    """(dataset, ids, truth) that the parsed options make of a drive that load_drive read, which stays as it is."""
    dataset, ids, truth = drive
    if options.good_twist:
        dataset = degradation.good_twist(dataset, truth, options.velocity_sigma, options.gyro_sigma, options.seed)
    frames = degradation.keep_tracks(degradation.frames_of(dataset, ids), options.every)
    frames = degradation.cut_tracks(frames, options.longest, options.drop_last)
    if options.traffic > 0.0:
        frames, _ = add_traffic(dataset, frames, truth, options.traffic, options.seed)
    if options.blackout:
        frames = degradation.black_out(frames, dataset.stamps, *options.blackout)
    return degradation.pack(dataset, frames) + (truth,)


def check(options):
    """Fill in the sigmas; InputError for a value out of range."""
    if options.velocity_sigma is None:
        options.velocity_sigma = GOOD_VELOCITY_SIGMA if options.good_twist else DEFAULT_VELOCITY_SIGMA
    if options.gyro_sigma is None:
        options.gyro_sigma = GOOD_GYRO_SIGMA if options.good_twist else DEFAULT_GYRO_SIGMA
    if options.gyro_bias_sigma is None:
        options.gyro_bias_sigma = (converter.INS_GYRO_BIAS_SIGMA if options.good_twist
                                   else converter.NOISY_GYRO_BIAS_SIGMA)
    converter.check_sigmas(options)
    for name, value in (("--every", options.every), ("--longest", options.longest)):
        if value is not None and value < 1:
            raise InputError("%s is %d, allowed: at least 1" % (name, value))
    for name, value in (("--drop-last", options.drop_last), ("--traffic", options.traffic)):
        if not 0.0 <= value < 1.0:
            raise InputError("%s is %g, allowed: from 0 to below 1" % (name, value))
    if options.seed < 0:
        raise InputError("--seed is %d, allowed: at least 0" % options.seed)
    check_output(options.output, options.input, ".bag", "OUT.bag")


def write(options, drive=None):
    """Do what the parsed options ask; InputError when something is refused. drive: what load_drive gives for them."""
    check(options)
    dataset, ids, truth = degraded(options, drive or load_drive(options.input, options.truth))
    from vi_ekf_slam.bag import writer  # needs ROS; complain about inputs first
    count = writer.record(as_recording(dataset, ids, truth, options), options.output, options.quiet)
    if not options.quiet:
        print("features: %.1f a frame in the mean" % dataset.seen.sum(axis=0).mean())
        print("wrote: %s, %d messages" % (options.output, count))


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused."""
    return exit_status(write, make_parser().parse_args(argv))
