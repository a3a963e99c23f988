#!/usr/bin/python3
"""Draw a simulated stream's noise anew: pixels about the points that its truth sees, the start about the true one, and
more noise of the IMU; to tell what of one run is chance. For evaluate.py --streams FOLDER. See --help."""

import argparse
import sys

import numpy as np
from scipy.spatial.transform import Rotation

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.output_file import check_output

SIGMA_STEPS = 64.0  # of sigma_q in a pixel
IMU = (("imu_gyro", "gyro_density", "gyro_walk"), ("imu_accel", "accel_density", "accel_walk"))


def true_pixels(stream):
    """uL vL uR vR (M, 4) px of each row of the stream without noise, from its poses and its map."""
    frame = np.repeat(np.arange(len(stream["cam_t"])), np.diff(stream["frame_ptr"]))
    order = np.argsort(stream["map_id"])
    points = stream["map_xyz"][order][np.searchsorted(stream["map_id"][order], stream["id"])].astype(float)
    pose = 1 + frame  # truth row 0 is the start
    in_imu = Rotation.from_quat(stream["truth_q"][pose]).inv().apply(points - stream["truth_p"][pose])
    extrinsics = stream["imu_T_rectleft"]
    x, y, z = ((in_imu - extrinsics[:3, 3]) @ extrinsics[:3, :3]).T
    camera = stream["K"]
    u, v = camera[0, 0] * x / z + camera[0, 2], camera[1, 1] * y / z + camera[1, 2]
    return np.stack([u, v, u - camera[0, 0] * stream["baseline"] / z, v], axis=1)


def redrawn(stream, seed, imu_noise):
    """The arrays of the stream with noise of `seed`; the IMU's own stays, and `imu_noise` times as much is added."""
    rng, result = np.random.default_rng(seed), dict(stream)
    pixels = true_pixels(stream)
    result["uv"] = (pixels + stream["sigma_q"] / SIGMA_STEPS * rng.standard_normal(pixels.shape)).astype(np.float32)
    error = np.linalg.cholesky(stream["P0_tight"]) @ rng.standard_normal(15)
    start = stream["init_truth"].copy()
    start[:4] = (Rotation.from_quat(start[:4]) * Rotation.from_rotvec(error[:3])).as_quat()
    start[4:] += error[3:]
    result["init_tight"] = start
    rate, size = float(stream["imu_rate"]), (len(stream["imu_t"]), 3)
    for samples, density, walk in IMU if imu_noise > 0.0 else ():
        white = imu_noise * stream[density] * np.sqrt(rate) * rng.standard_normal(size)
        bias = np.cumsum(imu_noise * stream[walk] / np.sqrt(rate) * rng.standard_normal(size), axis=0)
        result[samples] = (stream[samples] + white + bias - bias[0]).astype(np.float32)
        for key in (density, walk):
            result[key] = stream[key] * np.hypot(1.0, imu_noise)
    return result


def main(argv=None):
    """Entry point: 0 on success, 2 when the stream cannot be read or written."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stream", metavar="IN.npz", help="one of OpenVINS' simulator, see docs/inertial.md")
    parser.add_argument("output", metavar="OUT.npz")
    parser.add_argument("--seed", type=int, default=1, help="(default: %(default)s)")
    parser.add_argument("--imu-noise", type=float, default=0.0, metavar="K",
                        help="noise of the IMU to add, in that which it has; its densities become those of both (default: %(default)s)")
    options = parser.parse_args(argv)
    try:
        for name, value in (("--seed", options.seed), ("--imu-noise", options.imu_noise)):
            if not 0.0 <= value < np.inf:
                raise InputError("%s is %g, allowed: 0 or more" % (name, value))
        check_output(options.output, options.stream)
        with np.load(options.stream, allow_pickle=False) as stream:
            np.savez(options.output, **redrawn({key: stream[key] for key in stream.files}, options.seed, options.imu_noise))
    except (InputError, OSError, ValueError, KeyError) as error:
        print("error: %s" % error if isinstance(error, InputError) else "error: %s: %s" % (options.stream, error), file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
