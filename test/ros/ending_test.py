#!/usr/bin/env python3
"""Whatever ends the node, what it has computed is on the disk: all of it, or all but the last autosave_period."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import rospy
import rostest
from nav_msgs.msg import Odometry

import drive_data
from waiting import wait_for

START = 1000.0


class Ending(unittest.TestCase):
    """A node of its own for each signal."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node("ending_test")
        cls.publishers = {topic: rospy.Publisher(topic, type(message), queue_size=10000, latch=topic == "/tf_static")
                          for topic, message in drive_data.drive(0.0)}

    def setUp(self):
        self.output = tempfile.mkdtemp(prefix="vi_ekf_slam_ending_")
        self.addCleanup(shutil.rmtree, self.output, ignore_errors=True)

    def start_node(self, autosave_period):
        """Runs slam_node and waits until it listens."""
        for name, value in (("output_dir", self.output), ("autosave_period", autosave_period)):
            rospy.set_param("/slam_ending/" + name, value)
        self.wait_for(lambda: not any(p.get_num_connections() for p in self.publishers.values()))  # the last one's
        node = subprocess.Popen([drive_data.program("slam_node"), "__name:=slam_ending"], stderr=subprocess.DEVNULL,
                                stdout=subprocess.DEVNULL)
        self.addCleanup(node.wait)
        self.addCleanup(node.kill)
        self.wait_for(lambda: all(p.get_num_connections() > 0 for p in self.publishers.values()))
        return node

    def wait_for(self, condition, seconds=20.0):
        """Until `condition()`."""
        self.assertTrue(wait_for(condition, seconds), "in vain")

    def play(self, begin, end):
        """Publishes what lies between two times (s) of the drive."""
        for topic, message in drive_data.drive(end, START):
            if begin <= drive_data.stamp_of(message).to_sec() - START:
                self.publishers[topic].publish(message)
                time.sleep(0.02 if topic == "features" else 0.0)

    def poses(self):
        """Lines of the saved trajectory; none without a file."""
        path = os.path.join(self.output, "trajectory.tum")
        if not os.path.exists(path):
            return 0
        with open(path, encoding="ascii") as file:
            lines = file.read()
        self.assertTrue(lines.endswith("\n"), "half a file")
        self.assertTrue(all(len(line.split()) == 8 for line in lines.splitlines()))
        return len(lines.splitlines())

    def check_signal(self, number):
        """All that was published before the signal is saved, whole files only."""
        node = self.start_node(0)
        self.play(0.0, 3.0)
        time.sleep(0.3)  # on the way to the node
        self.assertEqual(0, self.poses())
        node.send_signal(number)
        self.assertEqual(0, node.wait(20))
        self.assertEqual(31, self.poses())
        names = sorted(os.listdir(self.output))
        self.assertEqual(["covariance.csv", "dead_reckoning.tum", "frames.csv", "landmarks.csv", "summary.yaml",
                          "trajectory.tum"], names)

    def test_sigint(self):
        """Control-C, roslaunch."""
        self.check_signal(signal.SIGINT)

    def test_sigterm(self):
        """kill, system shutdown."""
        self.check_signal(signal.SIGTERM)

    def test_sighup(self):
        """The terminal is closed."""
        self.check_signal(signal.SIGHUP)

    def test_sigkill_loses_the_last_period_only(self):
        """What was computed a period before is there, and whole."""
        node = self.start_node(0.5)
        odometry = []
        listener = rospy.Subscriber("odometry", Odometry, odometry.append, queue_size=1000)
        self.wait_for(lambda: listener.get_num_connections() > 0)
        self.play(0.0, 3.0)
        self.wait_for(lambda: odometry and odometry[-1].header.stamp.to_sec() >= START + 2.9)
        time.sleep(2.5)  # the period, and the s in which the node looks after such things
        self.play(3.1, 3.5)
        node.kill()
        node.wait(20)
        self.assertGreaterEqual(self.poses(), 30)
        self.assertTrue(os.path.exists(os.path.join(self.output, "summary.yaml")))
        listener.unregister()

    def test_a_period_that_is_none_is_refused(self):
        """Named with what is allowed."""
        for value in (-1.0, "often", True):
            rospy.set_param("/slam_ending/autosave_period", value)
            done = subprocess.run([drive_data.program("slam_node"), "__name:=slam_ending"], timeout=20, check=False,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            self.assertEqual(1, done.returncode)
            self.assertIn("autosave_period", done.stdout.decode())
        rospy.delete_param("/slam_ending")


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "ending", Ending, sys.argv)
