"""What an evaluation needs from a bag: frame stamps, the extrinsic and the recorded ground truth."""

from collections import namedtuple

import genpy
import numpy as np

from vi_ekf_slam.bag.connections import STATIC_TOPIC
from vi_ekf_slam.bag.limits import require_bounded_chunks
from vi_ekf_slam.bag.opening import open_bag, read_header
from vi_ekf_slam.bag.topics import TYPES, assign
from vi_ekf_slam.bag.transforms import chain, matrix_of, root

# Arguments of slam.launch whose topics say when the frames were, and which is the camera's frame; the first that is there.
# A driver may publish camera_info but once.
FRAMES, CAMERA = ("features", "left_image", "left_info"), ("features", "left_info", "left_image")

Reference = namedtuple("Reference", "frame_stamps cam_T_imu truth camera")
Reference.__doc__ = """frame_stamps (T,) s of the features, or of the left pictures where there are none; cam_T_imu 4 x 4
or None; truth: (stamps, map_T_imu poses) or None; camera: name of the left camera's frame or None."""


def read_reference(path, imu=None):
    """Read a bag, as dataset_to_bag.py writes them or with topics that can be told by their types and names (topics.assign).

    The camera's frame is the one that the features name, or else the left camera_info, and the IMU's is `imu` or, where
    that is None or nothing connects it, the one that the IMU's messages name; without an IMU it is the root above the camera, as
    the truth is the IMU's there too. The extrinsic is the transform between the two on /tf_static, directly or as a chain.
    """
    stamps, frames, transforms, truth = [], {}, [], None
    with open_bag(path) as bag:
        require_bounded_chunks(bag, path)
        present = bag.get_type_and_topic_info().topics
        topics, _ = assign({topic: info.msg_type for topic, info in present.items() if info.message_count}, {})
        wanted = [topics[name] for name in CAMERA + ("imu",) if name in topics]
        clock = next((topics[name] for name in FRAMES if name in topics), None)
        for topic, message, _ in bag.read_messages([STATIC_TOPIC, "/ground_truth/path"]):
            if topic == STATIC_TOPIC:
                transforms.extend(message.transforms)
            else:
                truth = _read_path(message)
        for topic, (_, data, _, _, kind), _ in bag.read_messages(wanted, raw=True) if wanted else ():
            if not kind._has_header:
                raise ValueError("%s has no header" % kind._type)
            stamp, frame = read_header(data)
            frames.setdefault(topic, frame)
            if topic == clock:
                stamps.append(genpy.Time(*divmod(stamp, 10**9)).to_sec())
    camera = next((frames[topics[name]] for name in CAMERA if name in topics), None)
    own = frames.get(topics.get("imu"))
    if camera is not None and not any(info.msg_type in TYPES["imu"] for info in present.values()):
        own = _above(transforms, camera)
    found = (_extrinsic(transforms, camera, frame) for frame in (imu if imu != camera else None, own))
    extrinsic = next((matrix for matrix in found if matrix is not None), None)
    return Reference(np.array(stamps), extrinsic, truth, camera)


def _read_path(message):
    poses = [matrix_of(p.pose) for p in message.poses]
    if not poses:
        return None
    bad = next((p.pose for p, pose in zip(message.poses, poses) if pose is None), None)
    if bad is not None:
        raise ValueError("a pose of the truth is none: %s, allowed: finite, with a quaternion of norm 1" % " ".join(str(bad).split()))
    return np.array([p.header.stamp.to_sec() for p in message.poses]), np.array(poses)


def _above(transforms, camera):
    """The root above the camera's frame, or None where nothing is above it."""
    camera = camera.lstrip("/")
    frame = root({t.child_frame_id.lstrip("/"): t.header.frame_id.lstrip("/") for t in transforms}, camera)
    return None if frame == camera else frame


def _extrinsic(transforms, camera, imu):
    return None if camera is None or imu is None else chain(transforms, camera, imu)
