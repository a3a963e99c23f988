#!/usr/bin/env python3
"""A bag through slam.launch and through run_bag gives the same files."""

import os
import subprocess
import sys

import numpy as np
import rospkg
import rostest
import yaml
from tf2_msgs.msg import TFMessage

import drive_data
from launch_runner import LIMIT, PACKAGE, LaunchRunner

SAME_FILES = ("trajectory.tum", "trajectory_smoothed.tum", "dead_reckoning.tum", "covariance.csv",
              "covariance_smoothed.csv", "landmarks.csv")


def _read(*path):
    with open(os.path.join(*path), encoding="ascii") as file:
        return file.read()


class Playback(LaunchRunner):
    """Runs both programs on the same generated bag."""

    def run_bag(self, config=None, name="run_bag", status=0):
        """Folder of run_bag's results, made anew; what it said is in self.said. `status`: what it ends with."""
        output = os.path.join(self.folder, name)
        config = self.config if config is None else config
        done = subprocess.run([drive_data.program("run_bag"), self.bag, "--output", output]
                              + (["--config", config] if config else []), check=False, timeout=LIMIT,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.said = done.stdout.decode()
        self.assertEqual(status, done.returncode, self.said)
        return output

    def check_equal(self, expected, actual, log):
        """The same text in all result files, and a frame for each that was recorded."""
        for name in SAME_FILES:
            self.assertTrue(os.path.isfile(os.path.join(actual, name)), log)
            self.assertEqual(_read(expected, name), _read(actual, name), name)
        self.assertEqual(61, len(_read(actual, "trajectory.tum").splitlines()))
        self.assertGreater(len(_read(actual, "landmarks.csv").splitlines()), 20)

    def test_node_and_nodelet_compute_what_run_bag_computes(self):
        """Byte for byte; the default folder of a bag's results is beside it."""
        expected = self.run_bag()
        log = self.play()
        self.check_equal(expected, os.path.join(self.folder, "drive_slam"), log)
        noise = [line for line in self.said.splitlines() if line.startswith("noise: ")]
        self.assertEqual(3, len(noise), self.said)
        for line in noise:
            self.assertEqual(1, log.count(line), log)
        nodelet = os.path.join(self.folder, "nodelet")
        log = self.play("nodelet:=true", "output_dir:=" + nodelet)
        self.check_equal(expected, nodelet, log)

    def test_a_name_with_an_apostrophe(self):
        """Of a bag and of a folder."""
        bag = os.path.join(self.folder, "it's.bag")
        os.rename(self.bag, bag)
        self.bag = bag
        log = self.play()
        self.assertEqual(61, len(_read(self.folder, "it's_slam", "trajectory.tum").splitlines()), log)

    def test_velocities_of_another_frame_are_carried_to_the_imu(self):
        """By a transform that comes later than the first of them; whichever message says it, as if the IMU's had."""
        of_imu = np.array([line.split() for line in _read(self.run_bag(), "trajectory.tum").splitlines()], float)
        for topic, make in (("velocity", drive_data.base_velocity), ("wheel_odometry", drive_data.wheel_odometry)):
            messages = []
            for name, message in drive_data.drive(gyro_per_frame=2):
                is_velocity = name == "velocity"
                messages.append((topic, make(drive_data.stamp_of(message))) if is_velocity else (name, message))
            late = next(i for i, (_, m) in enumerate(messages) if drive_data.stamp_of(m).to_sec() > 1000.5)
            transform = TFMessage([drive_data.base_extrinsic(drive_data.stamp_of(messages[late][1]))])
            messages.insert(late, ("/tf_static", transform))
            # The bag's order is that of recording: the first message is a velocity.
            messages.insert(0, messages.pop(next(i for i, (name, _) in enumerate(messages) if name == topic)))
            drive_data.write_bag(self.bag, messages)
            expected = self.run_bag(name="run_" + topic)
            log = self.play("output_dir:=" + os.path.join(self.folder, "node_" + topic))
            self.check_equal(expected, os.path.join(self.folder, "node_" + topic), log)
            summary = yaml.safe_load(_read(expected, "summary.yaml"))
            self.assertEqual(61, summary["processed"]["velocity"], summary)
            of_base = np.array([line.split() for line in _read(expected, "trajectory.tum").splitlines()], float)
            self.assertLess(np.abs(of_imu[:, 1:] - of_base[:, 1:]).max(), 1e-3, topic)

    def test_a_velocity_that_cannot_be_carried_is_named_once(self):
        """With its frame and what to do; the rest goes on without it."""
        for frame, advice in (("wheel", "/tf_static"), ("odom", "a frame of the vehicle is needed")):
            drive_data.write_bag(self.bag, [(t, drive_data.base_velocity(m.header.stamp, frame) if t == "velocity" else m)
                                            for t, m in drive_data.drive()])
            output = self.run_bag(name=frame, status=2)
            self.assertIn("no message on /velocity or /wheel_odometry could be used", self.said)
            problems = [line for line in self.said.splitlines() if "'%s'" % frame in line]
            self.assertEqual(1, len(problems), self.said)
            self.assertIn(advice, problems[0])
            self.assertEqual(61, len(_read(output, "trajectory.tum").splitlines()))

    def test_features_of_another_frame_are_named_once(self):
        """With both frames, and by the status; dead reckoning is written."""
        messages = drive_data.drive()
        for _, message in (m for m in messages if m[0] == "features"):
            message.header.frame_id = "left_camera"
        drive_data.write_bag(self.bag, messages)
        output = self.run_bag(status=2)
        named = "features in 'left_camera' are not used: /left/camera_info is of '%s'" % drive_data.LEFT
        self.assertEqual(1, self.said.count(named), self.said)
        self.assertIn("no message on /features could be used", self.said)
        self.assertIn("turned away: features: wrong frame: 61", self.said)
        self.assertEqual(61, len(_read(output, "trajectory.tum").splitlines()))

    def test_a_bag_without_features_ends_too(self):
        """Dead reckoning is saved, the same as run_bag's; the player's clock, which runs on, keeps nothing alive."""
        drive_data.write_bag(self.bag, [m for m in drive_data.drive(calibrated=False) if m[0] != "features"])
        expected = self.run_bag(status=2)
        self.assertIn("no message on /features", self.said)
        log = self.play()
        self.assertIn("no message yet on /features", log)
        for name in SAME_FILES:
            self.assertEqual(_read(expected, name), _read(self.folder, "drive_slam", name), log)
        self.assertEqual(61, len(_read(expected, "trajectory.tum").splitlines()))

    def test_inputs_that_never_come_are_errors_of_run_bag(self):
        """Each by its name; the rest is computed. Dead reckoning needs no features."""
        for name in ("imu", "velocity", "features"):
            output = os.path.join(self.folder, "without_" + name)
            done = subprocess.run([drive_data.program("run_bag"), self.bag, "--output", output, "--quiet",
                                   "--%s=/foo" % name], check=False, timeout=LIMIT, stderr=subprocess.PIPE)
            said = done.stderr.decode()
            lines = 2 if name == "imu" else 1  # velocities have nowhere to be carried to then, which is said too
            self.assertEqual((2, lines), (done.returncode, len(said.splitlines())), said)
            named = "/foo or /wheel_odometry" if name == "velocity" else "/foo"
            self.assertIn("no message on %s, which" % named, said)
            self.assertTrue(os.path.isfile(os.path.join(output, "summary.yaml")))
        config = os.path.join(rospkg.RosPack().get_path(PACKAGE), "config", "dead_reckoning.yaml")
        drive_data.write_bag(self.bag, [m for m in drive_data.drive(calibrated=False) if m[0] != "features"])
        self.run_bag(config)

    def test_poses_before_a_reset_are_named(self):
        """By run_bag, and in the summary."""
        drive_data.write_bag(self.bag, drive_data.drive(2.0) + drive_data.drive(1.0, start=2000.0))
        output = self.run_bag()
        self.assertIn("21 poses from before are in %s/before_reset_1\n" % output, self.said)
        self.assertEqual([21], yaml.safe_load(_read(output, "summary.yaml"))["poses_before_resets"])
        for name in ("trajectory.tum", "trajectory_smoothed.tum"):
            self.assertEqual(21, len(_read(output, "before_reset_1", name).splitlines()))

    def test_run_bag_without_a_configuration_takes_the_default_one(self):
        """Which is built in; its summary says so, and which noise it took from where."""
        default = os.path.join(rospkg.RosPack().get_path(PACKAGE), "config", "default.yaml")
        expected = self.run_bag(default, "named")
        output = self.run_bag("", "unnamed")
        for name in SAME_FILES:
            self.assertEqual(_read(expected, name), _read(output, name), name)
        self.assertEqual(61, len(_read(output, "trajectory.tum").splitlines()))
        summary = yaml.safe_load(_read(output, "summary.yaml"))
        self.assertEqual("built-in defaults", summary["config"])
        self.assertEqual({"value": 0.1, "unit": "m/s", "source": "from its messages"}, summary["noise"]["velocity"])
        self.assertEqual({"value": 1.0, "unit": "px", "source": "invariant/pixel_sigma"}, summary["noise"]["pixels"])

    def test_frames_correct_the_trajectory(self):
        """Guards the comparison: were the features ignored, equality would say little."""
        output = self.run_bag()
        self.assertNotEqual(_read(output, "trajectory.tum"), _read(output, "dead_reckoning.tum"))


if __name__ == "__main__":
    rostest.rosrun(PACKAGE, "playback", Playback, sys.argv)
