"""A checked drive (loader.Dataset) as a recordings.recording.Recording, which is what is written to a bag."""

import numpy as np

from vi_ekf_slam.common.checks import nanoseconds
from vi_ekf_slam.common.geometry import inverse, make_transform
from vi_ekf_slam.recordings.recording import Features, Gyro, Recording, Velocity, rectified_pair

# Rectified image sizes of the KITTI raw recordings by focal length in px: the files carry K but no image size.
KITTI_SIZES = {721.5377: (1242, 375), 707.0493: (1224, 370), 718.3351: (1238, 374), 707.0912: (1226, 370),
               718.856: (1241, 376)}


def as_recording(dataset, ids, truth, options):
    """The Recording of a Dataset.

    ids: (M, T) from stale.assign_ids, or None without features. truth: (stamps, poses) of truth.load_truth or None.
    options: gyro_sigma rad/s, velocity_sigma m/s, standard deviations per axis, and their _bias_sigma.
    """
    stamps = nanoseconds(dataset.stamps)
    recording = Recording(
        dataset.name, gyro=Gyro(stamps, dataset.angular_velocity.T, options.gyro_sigma),
        velocity=Velocity(stamps, dataset.linear_velocity.T, options.velocity_sigma),
        bias_sigmas=(options.velocity_bias_sigma, options.gyro_bias_sigma))
    if dataset.cam_T_imu is not None:
        recording.imu_T_left = inverse(dataset.cam_T_imu)
    if dataset.baseline is not None:
        recording.left_T_right = make_transform(np.eye(3), [dataset.baseline, 0.0, 0.0])
    if ids is not None:
        frames, tracks = np.nonzero(dataset.seen.T)
        pixels = dataset.features[:, tracks, frames].T
        starts = np.concatenate([[0], np.cumsum(dataset.seen.sum(axis=0))])
        recording.features = Features(stamps, starts, ids[tracks, frames], pixels, np.zeros(len(pixels)))
        recording.left, recording.right = rectified_pair(image_size(dataset.intrinsics, pixels), dataset.intrinsics,
                                                         dataset.baseline)
    if truth is not None:
        recording.truth = nanoseconds(truth[0]), truth[1]
    return recording


def image_size(intrinsics, pixels):
    """(width, height) in px: KITTI's where the focal length is one of KITTI's, else guessed from the principal point.

    Grown where needed so that every pixel (u, v) of pixels (M, 4) uL vL uR vR has u < width and v < height.
    """
    guess = (int(round(2.0 * intrinsics[0, 2])), int(round(2.0 * intrinsics[1, 2])))
    for focal_length, size in KITTI_SIZES.items():
        if abs(intrinsics[0, 0] - focal_length) < 1e-3:
            guess = size
    largest = [pixels[:, columns].max(initial=0.0) for columns in ([0, 2], [1, 3])]
    return tuple(max(1, side, int(np.floor(pixel)) + 1) for side, pixel in zip(guess, largest))
