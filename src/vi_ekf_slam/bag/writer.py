"""Write a drive as a bag.

Topics: /tf_static, /twist_bias, /ground_truth/path (latched, once, first), /left/camera_info, /right/camera_info, /imu,
/velocity, /features, /ground_truth/pose; at equal stamps in this order. A message's record time is its stamp.
Connections are first used in the same order, which is how readers that merge connections break ties.
"""

import sys

import numpy as np
import rosbag
from tqdm import tqdm

from vi_ekf_slam.bag import messages as make
from vi_ekf_slam.bag.connections import STATIC_TOPIC, latched
from vi_ekf_slam.common.output_file import replacing

BIAS_TOPIC, PATH_TOPIC = "/twist_bias", "/ground_truth/path"
LATCHED_TOPICS = (STATIC_TOPIC, BIAS_TOPIC, PATH_TOPIC)
POSE_TOPIC = "/ground_truth/pose"


def messages(dataset, ids, gyro_sigma, velocity_sigma, truth=None, bias_sigmas=None):
    """Yield (topic, stamp in s, message) in recording order.

    ids: (M, T) from stale.assign_ids, or None without features. gyro_sigma: rad/s, velocity_sigma: m/s, standard
    deviations per axis. truth: (stamps, poses) of truth.load_truth or None. bias_sigmas: m/s of the velocity's and rad/s
    of the gyro's constant bias, or None.
    """
    start = dataset.stamps[0]
    if dataset.cam_T_imu is not None:
        yield STATIC_TOPIC, start, make.static_transforms(start, dataset.cam_T_imu, dataset.baseline)
    if bias_sigmas is not None:
        yield BIAS_TOPIC, start, make.twist_bias(start, *bias_sigmas)
    truth_stamps, truth_poses = truth if truth is not None else ((), ())
    if truth is not None:
        yield PATH_TOPIC, start, make.truth_path(truth_stamps, truth_poses)
    size = None if ids is None else make.image_size(dataset.intrinsics, dataset.features, dataset.seen)

    n = 0  # next truth pose
    for k, stamp in enumerate(dataset.stamps):
        while n < len(truth_stamps) and truth_stamps[n] < stamp:
            yield POSE_TOPIC, truth_stamps[n], make.truth_pose(truth_stamps[n], truth_poses[n], n)
            n += 1
        if ids is not None:
            left, right = make.camera_infos(stamp, dataset.intrinsics, dataset.baseline, size, k)
            yield "/left/camera_info", stamp, left
            yield "/right/camera_info", stamp, right
        yield "/imu", stamp, make.imu(stamp, dataset.angular_velocity[:, k], gyro_sigma, k)
        yield "/velocity", stamp, make.velocity(stamp, dataset.linear_velocity[:, k], velocity_sigma, k)
        if ids is not None:
            seen = np.flatnonzero(dataset.seen[:, k])
            yield "/features", stamp, make.stereo_features(stamp, ids[seen, k], dataset.features[:, seen, k], k)
        while n < len(truth_stamps) and truth_stamps[n] == stamp:
            yield POSE_TOPIC, truth_stamps[n], make.truth_pose(truth_stamps[n], truth_poses[n], n)
            n += 1


def record(dataset, ids, truth, options):
    """Write a drive to options.output, with a bar unless options.quiet; returns the number of messages.

    dataset, ids, truth, options.gyro_sigma, velocity_sigma and their _bias_sigma: as in messages().
    """
    recording = messages(dataset, ids, options.gyro_sigma, options.velocity_sigma, truth,
                         (options.velocity_bias_sigma, options.gyro_bias_sigma))
    # Nothing but the terminal is worth a bar; a log would hold a thousand copies of it.
    with tqdm(recording, desc="messages", unit="", disable=options.quiet or not sys.stderr.isatty()) as progress:
        return write_bag(options.output, progress)


def write_bag(path, recording):
    """Write (topic, stamp, message) triples to `path`; returns the number of messages."""
    count = 0
    with replacing(path) as stream:
        bag = rosbag.Bag(stream, "w")
        for topic, stamp, message in recording:
            header = latched(topic, message) if topic in LATCHED_TOPICS else None
            bag.write(topic, message, make.ros_time(stamp), connection_header=header)
            count += 1
        bag.close()
    return count
