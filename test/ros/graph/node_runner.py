"""Nodes that a test starts and ends itself, and a drive to play to them."""

import shutil
import subprocess
import tempfile
import time
import unittest

import rospy

import drive_data
from waiting import wait_for

START = 1000.0


class NodeRunner(unittest.TestCase):
    """Each test has a folder of its own, in `output`."""

    name = "slam_node"  # of the node

    @classmethod
    def setUpClass(cls):
        rospy.init_node(cls.name + "_test")
        cls.publishers = {topic: rospy.Publisher(topic, type(message), queue_size=10000, latch=topic == "/tf_static")
                          for topic, message in drive_data.drive(0.0)}

    def setUp(self):
        self.output = tempfile.mkdtemp(prefix="vi_ekf_slam_%s_" % self.name)
        self.addCleanup(shutil.rmtree, self.output, ignore_errors=True)

    def set_parameters(self, parameters):
        """Only these are the node's."""
        if rospy.has_param("/" + self.name):
            rospy.delete_param("/" + self.name)
        for key, value in parameters.items():
            rospy.set_param("/%s/%s" % (self.name, key), value)

    def start_node(self, **parameters):
        """Runs slam_node and waits until it listens."""
        self.set_parameters(parameters)
        self.wait_for(lambda: not any(p.get_num_connections() for p in self.publishers.values()))  # the last one's
        node = subprocess.Popen([drive_data.program("slam_node"), "__name:=" + self.name], stderr=subprocess.DEVNULL,
                                stdout=subprocess.DEVNULL)
        self.addCleanup(node.wait)
        self.addCleanup(node.kill)
        self.wait_for(lambda: all(p.get_num_connections() > 0 for p in self.publishers.values()))
        return node

    def refused(self, **parameters):
        """What the node says that does not start with these."""
        self.set_parameters(parameters)
        done = subprocess.run([drive_data.program("slam_node"), "__name:=" + self.name], timeout=20, check=False,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.assertEqual(1, done.returncode)
        return done.stdout.decode()

    def wait_for(self, condition, seconds=20.0):
        """Until `condition()`."""
        self.assertTrue(wait_for(condition, seconds), "in vain")

    def play(self, begin, end, start=START):
        """Publishes what lies between two times (s) of the drive, which began at `start`."""
        for topic, message in drive_data.drive(end, start):
            if begin <= drive_data.stamp_of(message).to_sec() - start or topic == "/tf_static":
                self.publishers[topic].publish(message)
                time.sleep(0.02 if topic == "features" else 0.0)
