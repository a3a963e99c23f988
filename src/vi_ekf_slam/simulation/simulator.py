"""Command line of simulate_dataset.py: a simulated drive as an .npz of the course's format, with its truth beside it.

The drive itself comes from the program simulate_drive, which knows the options, their units and their limits.
"""

import argparse
import os
import subprocess
import sys
import tempfile

import numpy as np
from tqdm import tqdm

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.geometry import inverse, make_transform
from vi_ekf_slam.common.output_file import check_output, replacing
from vi_ekf_slam.common.package_files import package_program
from vi_ekf_slam.dataset.loader import DEFAULT_MAX_MEMORY_MB
from vi_ekf_slam.dataset.pose_files import tum_line

PROGRAM = "simulate_drive"
UNSEEN = -1.0
EDITIONS = ("original", "modern")
NANOSECONDS = 10**9


def make_parser(program):
    """The argument parser; the options of the drive are those that `program` describes."""
    parser = argparse.ArgumentParser(
        prog="simulate_dataset.py",
        description="Simulate a drive and write it as OUT.npz in the format of the real ones, with the true poses in "
                    "OUT_truth_left_camera.txt (KITTI: the left camera in the frame of its first pose) and "
                    "OUT_truth_imu.tum. The defaults resemble the real drives: noise, gyro bias, stale frames, "
                    "wrong matches, moving cars.")
    parser.add_argument("output", metavar="OUT.npz")
    parser.add_argument("--edition", choices=EDITIONS, default="original",
                        help="original: keys rotational_velocity and cam_T_imu, whose last column is the camera's "
                             "position in IMU axes, as in the real files; modern: angular_velocity and a true "
                             "imu_T_cam (default: %(default)s)")
    parser.add_argument("--quiet", action="store_true", help="no report and no progress bar")
    parser.add_argument("--images", action="store_true",
                        help="something else: a folder OUT with stereo pictures and an IMU; --images --help explains it")
    drive = parser.add_argument_group("the drive")
    described = subprocess.run([program, "--describe"], stdout=subprocess.PIPE, check=True, universal_newlines=True)
    names = []
    for line in described.stdout.splitlines():
        name, default, unit, text = line.split("\t")
        names.append(name)
        drive.add_argument("--" + name, metavar=unit.upper() or "VALUE",
                           help="%s (default: %s)" % (text.replace("%", "%%"), " ".join([default, unit]).strip()))
    return parser, names


def simulate(program, directory, options, quiet):
    """Let `program` write its arrays into `directory`. options: list of words. InputError with its complaint."""
    with subprocess.Popen([program, "--progress", directory] + options, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, universal_newlines=True) as process:
        try:
            with tqdm(total=100, desc="simulating", unit="%", disable=quiet or not sys.stderr.isatty()) as bar:
                for line in process.stdout:
                    bar.update(int(line.split()[1]) - bar.n)
            complaint = process.stderr.read().strip()
            if process.wait() != 0:
                raise InputError(complaint.replace(PROGRAM + ": ", "", 1) or "%s failed" % PROGRAM)
        finally:
            process.kill()


def load_arrays(directory):
    """The arrays of simulate_drive by name."""
    return {os.path.splitext(name)[0]: np.load(os.path.join(directory, name)) for name in os.listdir(directory)}


def pack(drive, edition):
    """Arrays of simulate_drive -> arrays of the .npz; landmark m is the id m."""
    frames, ids = len(drive["stamp"]), int(drive["observation_id"].max(initial=-1)) + 1
    needed_mb = 4 * ids * frames * 8 / 2**20
    if needed_mb > DEFAULT_MAX_MEMORY_MB:
        raise InputError("options 'duration' and 'laps': %d frames with %d ids take %.0f MB, allowed: %.0f MB"
                         % (frames, ids, needed_mb, DEFAULT_MAX_MEMORY_MB))
    features = np.full((4, ids, frames), UNSEEN)
    features[:, drive["observation_id"], drive["observation_frame"]] = drive["observation_pixels"].T
    whole, rest = np.divmod(drive["stamp"], NANOSECONDS)  # an int64 of today's nanoseconds does not fit a double
    arrays = {
        "time_stamps": (whole + rest / NANOSECONDS)[None, :],
        "linear_velocity": drive["twist"][:, :3].T,
        "rotational_velocity": drive["twist"][:, 3:].T,
        "features": features,
        "K": drive["K"],
        "b": drive["baseline"],
    }
    imu_T_cam = make_transform(drive["imu_T_cam"][:, :3], drive["imu_T_cam"][:, 3])
    if edition == "modern":
        arrays["angular_velocity"] = arrays.pop("rotational_velocity")
        arrays["imu_T_cam"] = imu_T_cam
    else:
        arrays["cam_T_imu"] = make_transform(imu_T_cam[:3, :3].T, imu_T_cam[:3, 3])
    return arrays


def camera_rows(drive):
    """KITTI rows (T, 12): the left camera's poses in the frame of its first."""
    last = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(drive["stamp"]), 1, 4))
    world_T_imu = np.concatenate([drive["world_T_imu"], last], axis=1)
    world_T_cam = world_T_imu @ np.vstack([drive["imu_T_cam"], [0.0, 0.0, 0.0, 1.0]])
    return (inverse(world_T_cam[0]) @ world_T_cam)[:, :3].reshape(-1, 12)


def imu_lines(drive):
    """TUM lines of the IMU's true poses."""
    for stamp, pose in zip(drive["stamp"], drive["world_T_imu"]):
        yield tum_line("%d.%09d" % (stamp // NANOSECONDS, stamp % NANOSECONDS), pose)


def report(drive, arrays, paths):
    """Lines that tell what was simulated."""
    counts = np.bincount(drive["observation_frame"], minlength=len(drive["stamp"]))
    tracks = np.bincount(drive["observation_id"]) if len(drive["observation_id"]) else np.zeros(1)
    length = np.linalg.norm(np.diff(drive["world_T_imu"][:, :, 3], axis=0), axis=1).sum()
    duration = arrays["time_stamps"][0, -1] - arrays["time_stamps"][0, 0]
    return ["frames: %d in %.1f s, %.0f m" % (len(counts), duration, length),
            "features a frame: %d to %d, median %d" % (counts.min(), counts.max(), np.median(counts)),
            "tracks: %d, median %d frames, longest %d" % (len(tracks), np.median(tracks), tracks.max()),
            "stale frames: %d" % drive["stale"].sum()] + ["wrote: %s" % path for path in paths]


def run(argv):
    """Do what the command line asks; InputError when something is refused."""
    argv = sys.argv[1:] if argv is None else argv
    if "--images" in argv:
        from vi_ekf_slam.simulation.pictures.drive import simulate_pictures
        simulate_pictures(argv)
        return
    program = package_program(PROGRAM)
    parser, names = make_parser(program)
    options = parser.parse_args(argv)
    check_output(options.output, suffix=".npz", name="OUT.npz")
    stem = os.path.splitext(options.output)[0]
    paths = [stem + "_truth_left_camera.txt", stem + "_truth_imu.tum", options.output]
    for path in paths[:2]:
        check_output(path)
    chosen = []
    for name in names:
        value = getattr(options, name.replace("-", "_"))
        chosen += [] if value is None else ["--" + name, value]
    with tempfile.TemporaryDirectory() as directory:
        simulate(program, directory, chosen, options.quiet)
        drive = load_arrays(directory)
    arrays = pack(drive, options.edition)
    with replacing(paths[0]) as truth, replacing(paths[1]) as imu, replacing(paths[2]) as output:
        np.savetxt(truth, camera_rows(drive), fmt="%.12g")
        imu.write(("\n".join(imu_lines(drive)) + "\n").encode("ascii"))
        np.savez_compressed(output, **arrays)
    if not options.quiet:
        print("\n".join(report(drive, arrays, paths)))


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused."""
    try:
        return exit_status(run, argv)
    except KeyboardInterrupt:
        return 130
