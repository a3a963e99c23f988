"""Write a recorded drive (recordings.recording.Recording) as a bag, and beside it what a bag has no message for.

Topics: /tf_static and /ground_truth/path (latched, once, first), /left/camera_info, /right/camera_info, /imu, /velocity,
/features, /left/image/compressed, /right/image/compressed, /ground_truth/pose; at equal stamps in this order.
OUT.imu.yaml: the IMU's noise as Kalibr states it. OUT.initial_state.yaml: a state to start from, see initial_state.py.
"""

import heapq
import os
import sys

from tqdm import tqdm

from vi_ekf_slam.bag import messages as make
from vi_ekf_slam.bag.connections import STATIC_TOPIC
from vi_ekf_slam.bag.writer import PATH_TOPIC, POSE_TOPIC, write_bag
from vi_ekf_slam.common.output_file import write_text
from vi_ekf_slam.recordings.imu_noise import kalibr_yaml, variances
from vi_ekf_slam.recordings.initial_state import to_yaml

IMU_TOPIC = "/imu"


def side_files(recording, output):
    """{path: text} of what goes beside the bag `output`."""
    stem = output[:-4] if output.endswith(".bag") else output
    files = {}
    if recording.imu is not None and recording.imu.noise is not None:
        files[stem + ".imu.yaml"] = kalibr_yaml(recording.imu.noise, IMU_TOPIC)
    if recording.initial_state is not None:
        files[stem + ".initial_state.yaml"] = to_yaml(recording.initial_state)
    return files


def record_recording(recording, output, quiet):
    """Write the bag and its side files, with a bar unless `quiet`; returns the number of messages."""
    with tqdm(messages(recording), desc="messages", unit="", disable=quiet or not sys.stderr.isatty()) as progress:
        count = write_bag(output, progress)
    for path, text in side_files(recording, output).items():
        write_text(path, text)
    return count


def messages(recording):
    """Yield (topic, stamp, message) in recording order."""
    start = make.from_nanoseconds(recording.start)
    if recording.imu_T_left is not None:
        yield STATIC_TOPIC, start, make.rig_transforms(start, recording.imu_T_left, recording.left_T_right)
    if recording.truth is not None:
        stamps = [make.from_nanoseconds(stamp) for stamp in recording.truth[0]]
        yield PATH_TOPIC, start, make.truth_path(stamps, recording.truth[1])
    streams = [stream for stream in (_cameras(recording), _imu(recording), _velocity(recording), _features(recording),
                                     _images(recording), _truth(recording))]
    for stamp, _, _, topic, message in heapq.merge(*(_ranked(k, stream) for k, stream in enumerate(streams)),
                                                   key=lambda entry: entry[:3]):
        yield topic, make.from_nanoseconds(stamp), message


def _ranked(rank, stream):
    for n, (stamp, topic, message) in enumerate(stream):
        yield int(stamp), rank, n, topic, message


def _cameras(recording):
    if recording.left is None:
        return
    for k, stamp in enumerate(recording.frame_stamps):
        for side, frame_id in (("left", make.LEFT_FRAME), ("right", make.RIGHT_FRAME)):
            yield stamp, "/%s/camera_info" % side, make.camera_info(make.from_nanoseconds(stamp), frame_id,
                                                                    getattr(recording, side), k)


def _imu(recording):
    if recording.imu is None:
        return
    imu = recording.imu
    gyro_variance, accelerometer_variance = (0.0, 0.0) if imu.noise is None else variances(imu.noise)
    for k, (stamp, rate, force) in enumerate(zip(imu.stamps, imu.angular_velocity.tolist(), imu.acceleration.tolist())):
        yield stamp, IMU_TOPIC, make.inertial(make.from_nanoseconds(stamp), rate, force, gyro_variance,
                                              accelerometer_variance, k)


def _velocity(recording):
    if recording.velocity is None:
        return
    for k, (stamp, linear) in enumerate(zip(recording.velocity.stamps, recording.velocity.linear.tolist())):
        yield stamp, "/velocity", make.velocity(make.from_nanoseconds(stamp), linear, recording.velocity.sigma, k)


def _features(recording):
    if recording.features is None:
        return
    features = recording.features
    for k, (stamp, begin, end) in enumerate(zip(features.stamps, features.starts[:-1], features.starts[1:])):
        yield stamp, "/features", make.stereo_features(
            make.from_nanoseconds(stamp), features.ids[begin:end], features.pixels[begin:end].T, k,
            features.sigmas[begin:end].tolist())


def _images(recording):
    if recording.images is None:
        return
    images = recording.images
    for k, (stamp, *paths) in enumerate(zip(images.stamps, images.left, images.right)):
        for side, frame_id, path in (("left", make.LEFT_FRAME, paths[0]), ("right", make.RIGHT_FRAME, paths[1])):
            with open(path, "rb") as stream:
                yield (stamp, "/%s/image/compressed" % side,
                       make.compressed_image(make.from_nanoseconds(stamp), frame_id, stream.read(),
                                             "png" if os.path.splitext(path)[1].lower() == ".png" else "jpeg", k))


def _truth(recording):
    if recording.truth is None:
        return
    for k, (stamp, pose) in enumerate(zip(*recording.truth)):
        yield stamp, POSE_TOPIC, make.truth_pose(make.from_nanoseconds(stamp), pose, k)
