"""Load the node through real topics and see what comes back, how late, and whether every message is accounted for."""

import argparse
import math
import os
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import BODY_R_OPTICAL, make_transform
from vi_ekf_slam.common.package_files import package_file, package_program
from vi_ekf_slam.common.stop_signals import end_if_told, signals_unwind
from vi_ekf_slam.common.yaml_file import read_yaml
from vi_ekf_slam.recordings.recording import rectified_pair
from vi_ekf_slam.ros.private_ros import FOREIGN, child, ros_master, set_parameter

SPEED, YAW_RATE = 8.0, 0.1  # m/s, rad/s
FX, CX, CY, BASELINE, WIDTH, HEIGHT = 700.0, 620.0, 190.0, 0.54, 1240, 380
GYRO_SIGMA, VELOCITY_SIGMA = 0.01, 0.1  # rad/s, m/s
VELOCITY_HZ = 100.0
PIXEL_SIGMA = 0.5  # px
START_LIMIT_S, END_LIMIT_S = 20.0, 30.0
# What a message can become, beside being processed.
DROPS = ("late", "duplicate", "stamp_ahead", "stamp_behind", "invalid")


class Street:
    """Points beside a circle that the car follows, and what a stereo camera at the IMU sees of them."""

    def __init__(self, features):
        rng = np.random.default_rng(1)
        radius = SPEED / YAW_RATE
        count = 60 * features
        angle = rng.uniform(0.0, 2.0 * math.pi, count)
        away = radius + rng.uniform(4.0, 25.0, count) * rng.choice([-1.0, 1.0], count)
        self.points = np.stack([away * np.sin(angle), radius - away * np.cos(angle), rng.uniform(-1.5, 4.0, count)], 1)
        self.features = features
        self.rng = rng

    def observe(self, elapsed):
        """(ids (n,), pixels (n, 4)) seen `elapsed` s after the start; n is `features` or a few less."""
        yaw, radius = YAW_RATE * elapsed, SPEED / YAW_RATE
        position = np.array([radius * math.sin(yaw), radius * (1.0 - math.cos(yaw)), 0.0])
        relative = self.points - position
        ahead = math.cos(yaw) * relative[:, 0] + math.sin(yaw) * relative[:, 1]
        left = -math.sin(yaw) * relative[:, 0] + math.cos(yaw) * relative[:, 1]
        candidates = np.flatnonzero((ahead > 4.0) & (ahead < 60.0))
        ahead, left, up = ahead[candidates], left[candidates], relative[candidates, 2]
        u, v, disparity = CX - FX * left / ahead, CY - FX * up / ahead, FX * BASELINE / ahead
        pixels = np.stack([u, v, u - disparity, v], 1) + self.rng.normal(0.0, PIXEL_SIGMA, (len(u), 4))
        seen = ((pixels >= 0.0) & (pixels < [WIDTH, HEIGHT, WIDTH, HEIGHT])).all(axis=1)
        return candidates[seen][:self.features], pixels[seen][:self.features]


class Traffic:
    """Publishes the three streams at their rates and notes when the results come. Needs the node's master."""

    def __init__(self, options):
        import rospy
        from geometry_msgs.msg import TwistWithCovarianceStamped
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import CameraInfo, Imu
        from tf2_msgs.msg import TFMessage
        from vi_ekf_slam.bag import messages
        from vi_ekf_slam.msg import StereoFeatureArray
        self.rospy, self.make, self.options = rospy, messages, options
        rospy.init_node("load_test", anonymous=True, disable_signals=True)
        self.street = Street(options.features)
        self.sent_at, self.frame_stamps, self.latency = {}, set(), {}
        self.sent = {"gyro": 0, "velocity": 0, "stereo": 0}

        def publisher(topic, kind, latch=False):
            return rospy.Publisher(topic, kind, queue_size=10000, latch=latch, tcp_nodelay=True)
        self.static = publisher("/tf_static", TFMessage, True)
        self.infos = [publisher(side + "/camera_info", CameraInfo, True) for side in ("left", "right")]
        self.imu = publisher("imu", Imu)
        self.velocity = publisher("velocity", TwistWithCovarianceStamped)
        self.frames = publisher("features", StereoFeatureArray)
        self.listener = rospy.Subscriber("odometry", Odometry, self.on_odometry, queue_size=10000, tcp_nodelay=True)

    def on_odometry(self, message):
        """A result: its latency is counted from when the measurement of its stamp was handed to ROS."""
        now, stamp = time.monotonic(), message.header.stamp.to_nsec()
        if stamp in self.sent_at:
            self.latency[stamp] = now - self.sent_at[stamp]

    def connected(self):
        """Whether the node listens to all and is listened to."""
        publishers = [self.static, self.imu, self.velocity, self.frames] + self.infos
        return all(p.get_num_connections() > 0 for p in publishers) and self.listener.get_num_connections() > 0

    def calibrate(self):
        """The camera: at the IMU, looking along its x axis."""
        now, intrinsics = self.rospy.Time.now(), np.array([[FX, 0.0, CX], [0.0, FX, CY], [0.0, 0.0, 1.0]])
        self.static.publish(self.make.rig_transforms(now, make_transform(BODY_R_OPTICAL, np.zeros(3)), None))
        frames = self.make.LEFT_FRAME, self.make.RIGHT_FRAME
        for info, frame, camera in zip(self.infos, frames, rectified_pair((WIDTH, HEIGHT), intrinsics, BASELINE)):
            info.publish(self.make.camera_info(now, frame, camera))

    def run(self):
        """Publishes for the duration; every message leaves at the time that its stamp says."""
        import genpy
        start_wall, start = time.time(), time.monotonic()
        ticks = int(self.options.duration * self.options.imu_rate)
        next_velocity = next_frame = 0.0
        for tick in range(ticks):
            end_if_told()
            elapsed = tick / self.options.imu_rate
            due = start + elapsed - time.monotonic()
            if due > 0.0:
                time.sleep(due)
            stamp = genpy.Time.from_sec(start_wall + elapsed)
            self.sent_at[stamp.to_nsec()] = time.monotonic()
            self.imu.publish(self.make.imu(stamp, (0.0, 0.0, YAW_RATE), GYRO_SIGMA**2))
            self.sent["gyro"] += 1
            if elapsed >= next_velocity:
                next_velocity += 1.0 / VELOCITY_HZ
                self.velocity.publish(self.make.velocity(stamp, (SPEED, 0.0, 0.0), VELOCITY_SIGMA))
                self.sent["velocity"] += 1
            if elapsed >= next_frame:
                next_frame += 1.0 / self.options.frame_rate
                self.send_frame(stamp, elapsed)
        return time.monotonic() - start

    def send_frame(self, stamp, elapsed):
        """What the camera sees."""
        ids, pixels = self.street.observe(elapsed)
        message = self.make.stereo_features(stamp, ids, pixels.tolist(), np.zeros(len(ids)))
        self.sent_at[stamp.to_nsec()] = time.monotonic()
        self.frames.publish(message)
        self.frame_stamps.add(stamp.to_nsec())
        self.sent["stereo"] += 1


def _wait(condition, limit, what):
    end = time.monotonic() + limit
    while not condition():
        end_if_told()
        if time.monotonic() > end:
            raise InputError(what)
        time.sleep(0.05)


def measure(options, folder):
    """(Traffic after its run, summary.yaml of the node as a dict, s that the run took)."""
    output = os.path.join(folder, "run")
    with ros_master(folder) as environment:
        for name, value in (read_yaml(options.config) or {}).items():
            set_parameter(environment, "/slam/" + name, value)
        set_parameter(environment, "/slam/output_dir", output)
        for name in FOREIGN:  # rospy, in this process, takes the namespace of whoever calls
            os.environ.pop(name, None)
        os.environ.update({key: environment[key] for key in ("ROS_MASTER_URI", "ROS_HOSTNAME", "ROS_LOG_DIR")})
        with child([options.node, "__name:=slam"], env=environment) as node:
            traffic = Traffic(options)
            _wait(traffic.connected, START_LIMIT_S, "the node does not start: " + options.node)
            traffic.calibrate()
            time.sleep(0.5)
            took = traffic.run()
            time.sleep(1.0)
            node.send_signal(signal.SIGINT)
            try:
                node.wait(END_LIMIT_S)
            except subprocess.TimeoutExpired as error:
                raise InputError("the node does not end on SIGINT") from error
        traffic.rospy.signal_shutdown("done")
    return traffic, read_yaml(os.path.join(output, "summary.yaml")), took


def account(sent, summary):
    """[(stream, sent, processed, dropped and counted, unaccounted)]."""
    rows = []
    for stream, topic in (("gyro", "imu"), ("velocity", "velocity"), ("stereo", "features")):
        dropped = sum(summary[key][stream] for key in DROPS)
        dropped += sum(count for reason, count in summary["turned_away"].items()
                       if reason.startswith(topic + ": message"))
        processed = summary["processed"][stream]
        rows.append((topic, sent[stream], processed, dropped, sent[stream] - processed - dropped))
    return rows


def report(traffic, summary, took):
    """Prints the tables; returns (messages unaccounted for, 95 % latency in s)."""
    print("sent in %.1f s of wall time" % took)
    print("%-10s %8s %10s %8s %12s" % ("input", "sent", "processed", "dropped", "unaccounted"))
    rows = account(traffic.sent, summary)
    for row in rows:
        print("%-10s %8d %10d %8d %12d" % row)
    for reason, count in sorted(summary["turned_away"].items()):
        print("  %s: %d" % (reason, count))
    everything = np.array(list(traffic.latency.values()))
    frames = np.array([value for stamp, value in traffic.latency.items() if stamp in traffic.frame_stamps])
    print("%-24s %8s %8s %8s %8s %8s" % ("latency (ms)", "results", "median", "95 %", "99 %", "longest"))
    for name, values in (("all odometry", everything), ("at stamps of frames", frames)):
        if len(values):
            print("%-24s %8d" % (name, len(values)) +
                  "".join(" %8.1f" % (1e3 * x) for x in (*np.percentile(values, (50, 95, 99)), values.max())))
    unaccounted = sum(abs(row[4]) for row in rows)
    return unaccounted, float(np.percentile(everything, 95)) if len(everything) else math.inf


def check(options):
    """InputError for a value out of range, before anything is started."""
    for value, name, unit in ((options.duration, "--duration", "s"), (options.imu_rate, "--imu-rate", "Hz"),
                              (options.frame_rate, "--frame-rate", "Hz"), (options.limit, "--limit", "s")):
        checks.require_positive(value, name, unit)
    if options.features < 0:
        raise InputError("--features is %d, allowed: at least 0" % options.features)


def main(arguments=None):
    """0; 1 when messages are lost unreported or results come too late; 2 when it cannot be measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=60.0, help="s")
    parser.add_argument("--imu-rate", type=float, default=400.0, help="Hz")
    parser.add_argument("--frame-rate", type=float, default=30.0, help="Hz")
    parser.add_argument("--features", type=int, default=300, help="in a frame")
    parser.add_argument("--config", default=None, help="YAML file; default: config/default.yaml")
    parser.add_argument("--node", default=None, help="slam_node to test; default: the workspace's")
    parser.add_argument("--limit", type=float, default=1.0, help="s; 95 %% of the results have to come within it")
    options = parser.parse_args(arguments)
    try:
        check(options)
        options.config = options.config or package_file("config", "default.yaml")
        options.node = package_program("slam_node") if options.node is None else options.node
        with signals_unwind(), tempfile.TemporaryDirectory(prefix="vi_ekf_slam_load_") as folder:
            unaccounted, late = report(*measure(options, folder))
    except (InputError, OSError) as error:
        print("load_test: %s" % error, file=sys.stderr)
        return 2
    if unaccounted:
        print("FAILED: %d messages are neither processed nor counted as dropped" % unaccounted)
    if late > options.limit:
        print("FAILED: 95 %% of the results came within %.3f s, not within %.3f s" % (late, options.limit))
    return 1 if unaccounted or late > options.limit else 0
