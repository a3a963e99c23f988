"""evaluate.py --streams: simulated streams of an IMU and stereo points through run_bag, beside OpenVINS' figures of them.

Each starts from the state that its file gives, so the truth's frame is the estimate's, and NEES is of the plain error.
"""

import glob
import os
import tempfile
import zlib
from collections import namedtuple

import numpy as np
import yaml

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.output_file import make_directory, write_text
from vi_ekf_slam.common.package_files import package_file
from vi_ekf_slam.common.yaml_file import read_mapping
from vi_ekf_slam.dataset.loader import DEFAULT_MAX_MEMORY_MB
from vi_ekf_slam.evaluation.against_truth import evaluate, judge_covariances
from vi_ekf_slam.evaluation.offline_run import run_bag
from vi_ekf_slam.evaluation.run_io import read_covariances, read_run

Figures = namedtuple("Figures", "ate orientation nees frame_ms")
Figures.__doc__ = """ate m and orientation deg: RMSE over all frames after alignment by yaw and position. nees: mean over the
frames of that of the pose (6 dof), without alignment. frame_ms: wall time of the whole run by the frames."""

# OpenVINS with the same stereo points and the same start: gore, V1_01, V2_02, known by the checksums of their files, since
# other noise may be drawn under the same name.
OPENVINS = {0x37E91DB8: Figures(0.0206, 0.10, 6.5, 6.0), 0x89029469: Figures(0.0161, 0.14, 8.3, 7.1),
            0xC583E601: Figures(0.0099, 0.10, 6.0, 7.4)}


def study_streams(options):
    """Convert, run and judge each .npz of the folder options.streams; prints a line a stream."""
    paths = sorted(glob.glob(os.path.join(options.streams, "*.npz")))
    if not paths:
        raise InputError("%s: holds no .npz, allowed: a folder of simulated streams" % options.streams)
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.output or scratch
        make_directory(folder)
        print("\n".join(header()), flush=True)
        for path in paths:
            name = os.path.splitext(os.path.basename(path))[0]
            frames, figures = run_stream(path, os.path.join(folder, name), options.config)
            print(line(name, frames, figures, OPENVINS.get(checksum(path))), flush=True)


def checksum(path):
    """CRC-32 of a file."""
    with open(path, "rb") as stream:
        return zlib.crc32(stream.read())


def run_stream(path, folder, config=None):
    """(number of frames judged, Figures) of one stream; bag, configuration and run are left in `folder`."""
    from vi_ekf_slam.bag.writer import record, side_files  # needs ROS
    from vi_ekf_slam.recordings.inertial_npz import load_inertial_npz
    make_directory(folder)
    recording = load_inertial_npz(path, DEFAULT_MAX_MEMORY_MB)
    bag, output = os.path.join(folder, "drive.bag"), os.path.join(folder, "run")
    record(recording, bag, quiet=True)
    noise, start = sorted(side_files(recording, bag), key=lambda file: file.endswith(".initial_state.yaml"))
    calibrated = os.path.join(folder, "config.yaml")
    write_text(calibrated, calibrated_config(config or package_file("config", "default.yaml"), noise))
    run_bag(bag, calibrated, output, "--initial-state", start)
    return judge(output, recording)


def calibrated_config(path, noise):
    """Text of the configuration at `path` with the IMU's calibration `noise`."""
    config = read_mapping(path, "a configuration")
    config.setdefault("inertial", {})["imu_calibration"] = os.path.abspath(noise)
    return yaml.safe_dump(config, sort_keys=False)


def judge(output, recording):
    """(number of frames judged, Figures) of the run in the directory `output`; InputError unless it has every frame."""
    run = read_run(output)
    if len(run.stamps) < len(recording.frame_stamps):
        raise InputError("%s: has %d poses for %d frames" % (output, len(run.stamps), len(recording.frame_stamps)))
    truth = recording.truth[0] * 1e-9, recording.truth[1]
    evaluation = evaluate(run.stamps, run.poses, truth, gauge="none")
    covariances = read_covariances(os.path.join(output, "covariance.csv"), run.stamps)
    consistency = judge_covariances(run.stamps, run.poses, covariances, truth, gauge="none")
    return evaluation.matched, Figures(evaluation.ate_yaw, evaluation.orientation, float(np.mean(consistency.nees)),
                                       1e3 * run.summary["wall_s"] / len(run.stamps))


def header():
    """Lines above the table."""
    columns = "%-8s %7s  %17s  %17s  %13s  %13s" % ("", "", "ATE (m)", "orientation (deg)", "pose NEES", "ms a frame")
    names = "%-8s %7s  %8s %8s  %8s %8s  %6s %6s  %6s %6s" % (("stream", "frames") + ("ours", "OpenV.") * 4)
    return [columns, names, "-" * len(names)]


def line(name, frames, ours, openvins=None):
    """One stream's line; openvins: its Figures, or None, which are dashes."""
    cells = []
    for pattern, width, mine, theirs in zip(("%.4f", "%.3f", "%.2f", "%.2f"), (8, 8, 6, 6), ours, openvins or [None] * 4):
        cells.append("%*s %*s" % (width, pattern % mine, width, "-" if theirs is None else pattern % theirs))
    return "%-8s %7d  %s" % (name, frames, "  ".join(cells))
