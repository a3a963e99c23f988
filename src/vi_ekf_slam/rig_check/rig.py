"""A recording of a rig, read once: all stamps and small messages; pictures are read later, as many as are wanted."""

import zlib
from collections import namedtuple

import numpy as np

from vi_ekf_slam.bag import topics as names
from vi_ekf_slam.bag.limits import require_bounded_chunks
from vi_ekf_slam.bag.opening import content, open_bag, read_header
from vi_ekf_slam.bag.transforms import chain
from vi_ekf_slam.common.errors import InputError

Stream = namedtuple("Stream", "topic stamps received frame_id")
Stream.__doc__ = """stamps, received (N,) ns, in the order in which they came; frame_id: of the first message."""

Imu = namedtuple("Imu", "gyro acceleration gyro_variance acceleration_variance")
Imu.__doc__ = """gyro (N, 3) rad/s, acceleration (N, 3) m/s^2, as the messages have them, IMU axes. Variances of one coordinate as
the first message states them: 0: not known, -1: not measured."""

NANO = 1e-9


class Rig:
    """What a bag holds of a rig. What it does not have is None or empty.

    path; given, topics: {argument of slam.launch: topic}, as they were named and all; guessed: those of them that nobody named; present: {topic: type}.
    streams: {argument: Stream}; imu: Imu; velocity (N, 3) m/s; frames: [(ids (M,), pixels (M, 4) uL vL uR vR)];
    feature_sigmas [(M,)] px, 0: not stated.
    repeats: {argument: (N,) bool}, of pictures and features: the message says what the one before said, but for its header.
    infos: {"left", "right": sensor_msgs/CameraInfo}; changed: sides whose calibration changes. transforms: [TransformStamped].
    origin ns: the earliest stamp, which times in s count from.
    """

    def __init__(self, path, given, duration):
        self.path, self.given = path, given
        self.streams, self.infos, self.changed, self.transforms = {}, {}, set(), []
        self.imu = self.velocity = self.velocity_name = None
        self.cameras = self.cam_T_imu = self.pairs = self.steps = self.motion = self.alignment = self.gyro_bias = self.noise = None  # of the checks
        self.rectified, self.noise_path = False, ""
        self.frames, self.feature_sigmas, self.repeats = [], [], {}
        with open_bag(path) as bag:
            require_bounded_chunks(bag, path)
            self.present = {topic: info.msg_type for topic, info in bag.get_type_and_topic_info().topics.items()}
            self.topics, self.guessed = names.assign(self.present, given)
            if not self.present:
                raise InputError("%s: holds no message" % path)
            self._read(bag, duration)
        known = [stream.stamps.min() for stream in self.streams.values() if len(stream.stamps)]
        self.origin = int(min(known)) if known else 0

    def seconds(self, stamps):
        """ns -> s after the origin."""
        return (np.asarray(stamps, dtype=np.int64) - self.origin) * NANO

    def _read(self, bag, duration):
        readers = {topic: name for name, topic in self.topics.items()}
        wanted = list(readers) + ["/tf_static", "/tf"]
        end = None
        rows = {name: [] for name in self.topics}
        values = {name: [] for name in self.topics}
        heads, said = {}, {name: [] for name in self.topics if name.endswith("image") or name == "features"}
        for topic, raw, received in bag.read_messages(wanted, raw=True):
            if topic.startswith("/tf"):
                self._transforms_of(raw)
                continue
            if end is None:  # transforms may have been written at any time before
                end = received.to_sec() + (duration or np.inf)
            if received.to_sec() > end:
                break
            name = readers[topic]
            message = self._message(raw) if not name.endswith("image") else None
            stamp, frame_id = (message.header.stamp.to_nsec(), message.header.frame_id) if message else read_header(raw[1])
            heads.setdefault(name, frame_id if name != "wheel_odometry" else message.child_frame_id)
            rows[name].append((stamp, received.to_nsec()))
            if name in said:
                said[name].append(zlib.crc32(content(raw[1])) if message is None or message.features else -len(rows[name]))
            self._value(name, message, values[name])
        for name, found in rows.items():
            if found:
                stamps = np.array(found, dtype=np.int64)
                self.streams[name] = Stream(self.topics[name], stamps[:, 0], stamps[:, 1], heads[name].lstrip("/"))
        self.repeats = {name: np.diff(found, prepend=0) == 0 for name, found in said.items()}
        self._keep(values)

    @staticmethod
    def _message(raw):
        message = raw[-1]()
        message.deserialize(raw[1])
        return message

    def _transforms_of(self, raw):
        known = {(t.header.frame_id, t.child_frame_id) for t in self.transforms}
        for transform in self._message(raw).transforms:
            if (transform.header.frame_id, transform.child_frame_id) not in known:
                self.transforms.append(transform)

    def _value(self, name, message, values):
        if name == "imu":
            w, a = message.angular_velocity, message.linear_acceleration
            if not values:
                self._variances = message.angular_velocity_covariance[0], message.linear_acceleration_covariance[0]
            values.append((w.x, w.y, w.z, a.x, a.y, a.z))
        elif name in ("velocity", "wheel_odometry"):
            v = message.twist.twist.linear
            values.append((v.x, v.y, v.z))
        elif name == "features":
            points = [(f.u_left, f.v_left, f.u_right, f.v_right, f.sigma) for f in message.features]
            table = np.array(points, dtype=float).reshape(-1, 5)
            self.feature_sigmas.append(table[:, 4])
            values.append((np.array([f.id for f in message.features], dtype=np.uint64), table[:, :4]))
        elif name.endswith("info"):
            side = name.split("_")[0]
            first = self.infos.setdefault(side, message)
            if (first.P, first.K, first.R, first.D) != (message.P, message.K, message.R, message.D):
                self.changed.add(side)

    def _keep(self, values):
        if values.get("imu"):
            table = np.array(values["imu"])
            self.imu = Imu(table[:, :3], table[:, 3:], *self._variances)
        self.frames = values.get("features", [])
        self.velocity_name = next((name for name in ("velocity", "wheel_odometry") if values.get(name)), None)
        if self.velocity_name:
            self.velocity = np.array(values[self.velocity_name])

    @property
    def has_acceleration(self):
        """Whether the IMU's messages carry accelerations, as the node judges it."""
        return self.imu is not None and self.imu.acceleration_variance != -1.0 and bool(np.any(self.imu.acceleration))

    @property
    def stated_sigma(self):
        """px, the median of what features state of their noise; 0: nothing."""
        sigmas = np.concatenate(self.feature_sigmas or [np.zeros(0)])
        stated = sigmas[sigmas >= 0.0]
        return float(np.median(stated)) if len(stated) else 0.0

    @property
    def frame_name(self):
        """The stream of stereo frames: features where they are there, else the left pictures; None: there is none."""
        return next((name for name in ("features", "left_image") if name in self.streams), None)

    def left_T_imu(self):
        """4 x 4, from the IMU's axes to the left camera's as it is mounted; None where no chain of transforms leads there."""
        if "imu" not in self.streams or "left" not in self.infos:
            return None
        return chain(self.transforms, self.infos["left"].header.frame_id, self.streams["imu"].frame_id)
