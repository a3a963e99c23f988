"""Write a recorded drive (recordings.recording.Recording) as a bag, and beside it what a bag has no message for.

Topics: /tf_static, /twist_bias and /ground_truth/path (latched, once, first), /left/camera_info, /right/camera_info, /imu,
/velocity, /features, /left/image/compressed, /right/image/compressed, /ground_truth/pose; at equal stamps in this order.
A message's record time is its stamp. Connections are first used in the same order, which is how readers that merge
connections break ties.
OUT.imu.yaml: the IMU's noise as Kalibr states it. OUT.initial_state.yaml: a state to start from, see initial_state.py.
"""

import heapq
import os
import sys

import rosbag
from tqdm import tqdm

from vi_ekf_slam.bag import messages as make
from vi_ekf_slam.bag.connections import STATIC_TOPIC, latched
from vi_ekf_slam.common.output_file import replacing, write_text
from vi_ekf_slam.recordings.imu_noise import kalibr_yaml, variances
from vi_ekf_slam.recordings.initial_state import to_yaml

IMU_TOPIC, BIAS_TOPIC = "/imu", "/twist_bias"
PATH_TOPIC, POSE_TOPIC = "/ground_truth/path", "/ground_truth/pose"
LATCHED_TOPICS = (STATIC_TOPIC, BIAS_TOPIC, PATH_TOPIC)


def side_files(recording, output):
    """{path: text} of what goes beside the bag `output`."""
    stem = output[:-4] if output.endswith(".bag") else output
    files = {}
    if recording.imu is not None and recording.imu.noise is not None:
        files[stem + ".imu.yaml"] = kalibr_yaml(recording.imu.noise, IMU_TOPIC)
    if recording.initial_state is not None:
        files[stem + ".initial_state.yaml"] = to_yaml(recording.initial_state)
    return files


def record(recording, output, quiet):
    """Write the bag and its side files, with a bar unless `quiet`; returns the number of messages."""
    # Nothing but the terminal is worth a bar; a log would hold a thousand copies of it.
    with tqdm(messages(recording), desc="messages", unit="", disable=quiet or not sys.stderr.isatty()) as progress:
        count = write_bag(output, progress)
    for path, text in side_files(recording, output).items():
        write_text(path, text)
    return count


def write_bag(path, entries):
    """Write (topic, stamp, message) triples to `path`; returns the number of messages."""
    count = 0
    with replacing(path) as stream:
        bag = rosbag.Bag(stream, "w")
        for topic, stamp, message in entries:
            header = latched(topic, message) if topic in LATCHED_TOPICS else None
            bag.write(topic, message, stamp, connection_header=header)
            count += 1
        bag.close()
    return count


def messages(recording):
    """Yield (topic, stamp, message) in recording order."""
    start = make.ros_time(recording.start)
    if recording.imu_T_left is not None:
        yield STATIC_TOPIC, start, make.rig_transforms(start, recording.imu_T_left, recording.left_T_right)
    if recording.bias_sigmas is not None:
        yield BIAS_TOPIC, start, make.twist_bias(start, *recording.bias_sigmas)
    if recording.truth is not None:
        stamps = [make.ros_time(stamp) for stamp in recording.truth[0]]
        yield PATH_TOPIC, start, make.truth_path(stamps, recording.truth[1])
    streams = {"left": _cameras, "imu": _imu, "gyro": _gyro, "velocity": _velocity, "features": _features, "images": _images,
               "truth": _truth}
    present = [stream(recording) for name, stream in streams.items() if getattr(recording, name) is not None]
    for topic, message in heapq.merge(*present, key=lambda entry: entry[1].header.stamp.to_nsec()):
        yield topic, message.header.stamp, message


def _cameras(recording):
    for k, stamp in enumerate(recording.frame_stamps):
        for side, frame_id in (("left", make.LEFT_FRAME), ("right", make.RIGHT_FRAME)):
            yield "/%s/camera_info" % side, make.camera_info(make.ros_time(stamp), frame_id, getattr(recording, side), k)


def _imu(recording):
    imu = recording.imu
    gyro_variance, accelerometer_variance = (0.0, 0.0) if imu.noise is None else variances(imu.noise)
    for k, (stamp, rate, force) in enumerate(zip(imu.stamps, imu.angular_velocity.tolist(), imu.acceleration.tolist())):
        yield IMU_TOPIC, make.imu(make.ros_time(stamp), rate, gyro_variance, force, accelerometer_variance, k)


def _gyro(recording):
    for k, (stamp, rate) in enumerate(zip(recording.gyro.stamps, recording.gyro.angular_velocity.tolist())):
        yield IMU_TOPIC, make.imu(make.ros_time(stamp), rate, recording.gyro.sigma**2, seq=k)


def _velocity(recording):
    for k, (stamp, linear) in enumerate(zip(recording.velocity.stamps, recording.velocity.linear.tolist())):
        yield "/velocity", make.velocity(make.ros_time(stamp), linear, recording.velocity.sigma, k)


def _features(recording):
    features = recording.features
    for k, (stamp, begin, end) in enumerate(zip(features.stamps, features.starts[:-1], features.starts[1:])):
        yield "/features", make.stereo_features(make.ros_time(stamp), features.ids[begin:end], features.pixels[begin:end].tolist(),
                                                features.sigmas[begin:end].tolist(), k)


def _images(recording):
    images = recording.images
    for k, (stamp, *paths) in enumerate(zip(images.stamps, images.left, images.right)):
        for side, frame_id, path in (("left", make.LEFT_FRAME, paths[0]), ("right", make.RIGHT_FRAME, paths[1])):
            with open(path, "rb") as stream:
                data = stream.read()
            encoding = "png" if os.path.splitext(path)[1].lower() == ".png" else "jpeg"
            yield "/%s/image/compressed" % side, make.compressed_image(make.ros_time(stamp), frame_id, data, encoding, k)


def _truth(recording):
    for k, (stamp, pose) in enumerate(zip(*recording.truth)):
        yield POSE_TOPIC, make.truth_pose(make.ros_time(stamp), pose, k)
