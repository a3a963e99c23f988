"""A recorded drive, whatever format it came in. Stamps are integer nanoseconds, as ROS and most recorders count them."""

from bisect import bisect_left
from collections import namedtuple

import numpy as np

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError

Imu = namedtuple("Imu", "stamps angular_velocity acceleration noise")
Imu.__doc__ = """stamps (N,) ns; angular_velocity (N, 3) rad/s, acceleration (N, 3) m/s^2: specific force, IMU axes.
noise: imu_noise.ImuNoise or None where the recording does not say."""

Gyro = namedtuple("Gyro", "stamps angular_velocity sigma")
Gyro.__doc__ = """Without an accelerometer. stamps (N,) ns; angular_velocity (N, 3) rad/s, IMU axes; sigma: standard deviation of each."""

Velocity = namedtuple("Velocity", "stamps linear sigma")
Velocity.__doc__ = """stamps (N,) ns; linear (N, 3) m/s of the IMU in its axes; sigma: standard deviation of each, m/s."""

Features = namedtuple("Features", "stamps starts ids pixels sigmas")
Features.__doc__ = """Stereo points of T frames. stamps (T,) ns; frame k has the rows starts[k] to starts[k + 1] (T + 1,) of
ids (M,), pixels (M, 4) uL vL uR vR of the rectified pair, and sigmas (M,) px."""

Images = namedtuple("Images", "stamps left right")
Images.__doc__ = """T stereo pairs: stamps (T,) ns; left, right: paths of PNG or JPEG files."""

Camera = namedtuple("Camera", "size intrinsics model distortion rectification projection")
Camera.__doc__ = """What sensor_msgs/CameraInfo states: size (width, height), K (3, 3), distortion_model and D (of the
images as they are), R (3, 3) and P (3, 4) of the rectified pair."""

InitialState = namedtuple("InitialState", "stamp world_T_imu velocity gyro_bias accelerometer_bias covariance")
InitialState.__doc__ = """A state to start from, see initial_state.py. stamp ns; covariance (15, 15)."""


class Recording:
    """One drive. What it does not have is None.

    name: for reports.  imu: Imu, or gyro: Gyro.  velocity: Velocity.  features: Features.  images: Images.
    left, right: Camera.  imu_T_left, left_T_right: 4 x 4, of the cameras that the images or features are from.
    truth: (stamps (N,) ns, map_T_imu (N, 4, 4)).  initial_state: InitialState.
    bias_sigmas: m/s of the velocity's and rad/s of the gyro's constant bias, standard deviations.
    notes: list of text, what a reader should know about how the drive was read.
    """

    def __init__(self, name, **fields):
        self.name = name
        self.imu = self.gyro = self.velocity = self.features = self.images = self.left = self.right = None
        self.imu_T_left = self.left_T_right = self.truth = self.initial_state = self.bias_sigmas = None
        self.notes = []
        for key in fields:
            if not hasattr(self, key):
                raise AttributeError(key)
        self.__dict__.update(fields)

    @property
    def frame_stamps(self):
        """(T,) ns of the stereo frames."""
        return (self.images or self.features).stamps

    @property
    def start(self):
        """The first stamp, ns."""
        streams = (self.imu, self.gyro, self.velocity, self.features, self.images)
        return int(min(stream.stamps[0] for stream in streams if stream is not None))


def rectified_pair(size, intrinsics, baseline):
    """(left, right) Camera of images that are rectified already. intrinsics 3 x 3 px, baseline m."""
    return tuple(
        Camera(tuple(size), intrinsics, "plumb_bob", np.zeros(5), np.eye(3),
               np.column_stack([intrinsics, [offset, 0.0, 0.0]]))
        for offset in (0.0, -intrinsics[0, 0] * baseline))


def require_increasing(stamps, name):
    """(N,) integer ns: within what a ROS time can hold, and each after the one before."""
    stamps = _within_ros_time(stamps, name)
    if (np.diff(stamps) <= 0).any():
        k = int(np.argmax(np.diff(stamps) <= 0)) + 1
        raise InputError("%s is not increasing: %d ns at index %d comes after %d ns" % (name, stamps[k], k, stamps[k - 1]))


def increasing_rows(stamps, name, faults):
    """(N,) bool of (N,) integer ns: as many rows as can be whose stamps increase; the others are added to `faults`.

    The longest increasing subsequence: one stamp that is far ahead must not take all that follow with it.
    """
    stamps = _within_ros_time(stamps, name)
    last, rows, before = [], [], np.full(len(stamps), -1)  # by length: the smallest last stamp, its row; row before each
    for k, stamp in enumerate(stamps.tolist()):
        length = bisect_left(last, stamp)
        before[k] = rows[length - 1] if length else -1
        if length == len(last) or stamp < last[length]:  # of equal ones the first stays
            last[length:length + 1], rows[length:length + 1] = [stamp], [k]
    kept, k = np.zeros(len(stamps), dtype=bool), rows[-1]
    while k >= 0:
        kept[k], k = True, before[k]
    for k in np.flatnonzero(~kept):
        faults.add("%s is not increasing: %d ns at index %d is not between its neighbours" % (name, stamps[k], k))
    return kept


def _within_ros_time(stamps, name):
    stamps = np.asarray(stamps)
    outside = (stamps < 1) | (stamps >= checks.MAX_ROS_SECONDS * 10**9)
    if outside.any():
        k = int(np.argmax(outside))
        raise InputError("%s is %d ns at index %d, allowed: from 1 to %d s" % (name, stamps[k], k, checks.MAX_ROS_SECONDS))
    return stamps
