"""Rigs in perfect order, in memory, and bags of them with something broken. SI units, stamps in ns."""

import io
import subprocess

import cv2
import numpy as np
from conftest import HANG_S, program

from vi_ekf_slam.bag.writer import messages, write_bag
from vi_ekf_slam.common.geometry import BODY_R_OPTICAL, inverse, make_transform, so3_exp
from vi_ekf_slam.recordings.imu_noise import ImuNoise
from vi_ekf_slam.recordings.recording import Features, Imu, Recording, Velocity, rectified_pair
from vi_ekf_slam.simulation.pictures.motion import felt, velocity

START = 1600000000 * 10**9
NOISE = ImuNoise(1.7e-4, 2e-5, 2e-3, 3e-3, 200.0)
K = np.array([[400.0, 0, 319.5], [0, 400.0, 199.5], [0, 0, 1.0]])
SIZE, BASELINE = (640, 400), 0.2
IMU_T_LEFT = make_transform(BODY_R_OPTICAL, [0.15, 0.1, 0.05])
DURATION, FRAME_RATE, POINTS = 8.0, 10.0, 900
PIXEL_SIGMA = 0.3


class ShakenRig:
    """A hand that shakes a rig in a room: turns about all axes and accelerates."""

    def pose(self, t):
        """World_T_imu (4 x 4)."""
        turn = so3_exp([0.15 * np.sin(2.9 * t), 0.2 * np.sin(2.1 * t + 1.0), 0.4 * np.sin(1.3 * t)])
        return make_transform(turn, [0.5 * np.sin(2.3 * t), 0.4 * np.sin(3.1 * t + 0.5), 1.4 + 0.3 * np.sin(2.7 * t + 1.0)])


class RigOnWheels:
    """It drives along x and turns about the vertical alone."""

    def __init__(self, speed, turn, frequency=0.8):
        self.speed, self.turn, self.frequency = speed, turn, frequency  # m/s, rad, rad/s

    def pose(self, t):
        """World_T_imu (4 x 4)."""
        return make_transform(so3_exp([0.0, 0.0, self.turn * np.sin(self.frequency * t)]), [self.speed * t, 0.0, 1.4])


class RigAtRest:
    """On a table."""

    def pose(self, _):
        """World_T_imu (4 x 4)."""
        return make_transform(np.eye(3), [0.0, 0.0, 1.4])


def still_points():
    """Recording of a rig at rest."""
    return shaken_points(motion=RigAtRest())


def room(random):
    """(POINTS, 3) m."""
    return np.column_stack([random.uniform(2.0, 6.0, POINTS), random.uniform(-4.0, 4.0, POINTS), random.uniform(-1.0, 4.0, POINTS)])


def street(random):
    """(N, 3) m: houses on both sides of the x axis."""
    return np.column_stack([random.uniform(-10.0, 400.0, 8000), random.choice([-1, 1], 8000) * random.uniform(4.0, 25.0, 8000),
                            random.uniform(0.0, 8.0, 8000)])


def shaken_points(with_velocity=False, seed=1, motion=ShakenRig(), first_frame=0.02, place=room, frame_rate=FRAME_RATE,
                  baseline=BASELINE, pixel_sigma=PIXEL_SIGMA, right_late=0.0):
    """Recording with features from first_frame s on and an accelerometer, and the IMU's velocity where that is wanted. right_late s:
    the right camera is exposed later than the left one, with its stamp."""
    random = np.random.default_rng(seed)
    count = int(DURATION * NOISE.rate)
    times = np.arange(count) / NOISE.rate
    exact = np.array([np.concatenate(felt(motion, t)) for t in times])
    white = np.sqrt(NOISE.rate) * np.repeat([NOISE.gyro_density, NOISE.accelerometer_density], 3)
    measured = exact + np.repeat([0.004, 0.05], 3) + white * random.normal(size=exact.shape)
    stamps = START + np.rint(1e9 * times).astype(np.int64)
    points = place(random)
    frame_times = np.arange(first_frame, DURATION - 0.05, 1.0 / frame_rate)
    ids, pixels, starts = [], [], [0]
    for t in frame_times:
        q, late = ((inverse(motion.pose(x) @ IMU_T_LEFT) @ np.column_stack([points, np.ones(len(points))]).T)[:3] for x in (t, t + right_late))
        uv, uv_late = (K @ (q / q[2]))[:2], (K @ (late / late[2]))[:2]
        row = np.stack([uv[0], uv[1], uv_late[0] - K[0, 0] * baseline / late[2], uv_late[1]])
        seen = np.flatnonzero((q[2] > 0.5) & (row[[0, 2]] > 5).all(axis=0) & (row[[0, 2]] < SIZE[0] - 5).all(axis=0) & (row[1] > 5)
                              & (row[1] < SIZE[1] - 5))[:90]
        ids.append(seen)
        pixels.append(row[:, seen].T + pixel_sigma * random.normal(size=(len(seen), 4)))
        starts.append(starts[-1] + len(seen))
    ids, pixels = np.concatenate(ids), np.concatenate(pixels)
    left, right = rectified_pair(SIZE, K, baseline)
    fields = dict(imu=Imu(stamps, measured[:, :3], measured[:, 3:], NOISE), left=left, right=right, imu_T_left=IMU_T_LEFT,
                  left_T_right=make_transform(np.eye(3), [baseline, 0, 0]),
                  features=Features(START + np.rint(1e9 * frame_times).astype(np.int64), np.array(starts), ids, pixels,
                                    np.full(len(ids), pixel_sigma)))
    if with_velocity:
        body = np.array([motion.pose(t)[:3, :3].T @ velocity(motion, t) for t in times[::4]])
        fields["velocity"] = Velocity(stamps[::4], body + 0.02 * random.normal(size=body.shape), 0.02)
    return Recording("shaken", **fields)


def message_list(recording):
    """[[topic, record time, message]], which a fault may change in place."""
    return [list(entry) for entry in messages(recording)]


def write(path, entries):
    """A bag of them, in the order of their record times."""
    write_bag(path, sorted(entries, key=lambda entry: (entry[1].to_nsec(), "info" not in entry[0] and "tf" not in entry[0])))
    return path


def run_bag(bag, output):
    """The finished run_bag, which says nothing but what is wrong."""
    return subprocess.run([program("run_bag"), bag, "--output", output, "--quiet"], stdout=subprocess.DEVNULL,
                          stderr=subprocess.PIPE, universal_newlines=True, timeout=HANG_S, check=False)


def of(entries, *topics):
    """Those whose topic has one of the beginnings."""
    return [entry for entry in entries if entry[0].startswith(topics)]


def without(entries, *topics):
    """The others."""
    return [entry for entry in entries if not entry[0].startswith(topics)]


def shift_stamps(entries, seconds, *topics):
    """The stamps of these topics are later by so much; the times of record stay."""
    import genpy
    for _, _, message in of(entries, *topics):
        message.header.stamp = genpy.Time.from_sec(0) + genpy.Duration(nsecs=message.header.stamp.to_nsec() + int(1e9 * seconds))
    return entries


def change_pictures(entries, side, change):
    """change(image) of each picture of one side, as JPEG again."""
    for _, _, message in of(entries, "/%s/image" % side):
        image = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_GRAYSCALE)
        message.data = cv2.imencode(".jpg", change(image), [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    return entries


def blurred(image):
    """Out of focus."""
    return cv2.GaussianBlur(image, (0, 0), 3.0)


def read(path, span):
    """Entries of a bag's first `span` s."""
    import rosbag
    with rosbag.Bag(path) as bag:
        entries = [[topic, time, message] for topic, message, time in bag.read_messages()]
    return [entry for entry in entries if (entry[1] - entries[0][1]).to_sec() <= span and not entry[0].startswith("/ground_truth")]


def copies(entries):
    """The same, to be broken."""
    return [[topic, time, _copy(message)] for topic, time, message in entries]


def _copy(message):
    """What would be read from a bag: ten times as fast as deepcopy."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return type(message)().deserialize(buffer.getvalue())
