"""Nodes that a test starts and ends itself, and a drive to play to them."""

import resource
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

import rospy
from nav_msgs.msg import Odometry

import drive_data
from waiting import wait_for

START = 1000.0
# Bytes of a file: less than the records of 800 poses, more than the log and what is saved of those before.
LITTLE_ROOM = 400000
# A busy machine may serve the connections far apart: that makes nothing late, and nothing is shed.
PATIENT = {"buffer": {"max_delay_s": 2.0}, "ros": {"max_latency_s": 0.0}}
# The tracks of the drive do not slip.
WITHOUT_SLIP = {"slip_sigma": 0.0}


def bound_files(size=LITTLE_ROOM):
    """For a process that starts: writing more than that (bytes of a file) fails, as on a disk that is full."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def leave_no_memory(process):
    """It cannot make another thread from now on: a fault in what computes, where that resumes and a reset comes."""
    with open("/proc/%d/status" % process.pid, encoding="ascii", errors="replace") as file:
        size = next(int(line.split()[1]) for line in file if line.startswith("VmSize:"))
    limit = 1024 * size + 2 ** 20  # bytes: enough for what is saved at the end, less than a thread's stack
    resource.prlimit(process.pid, resource.RLIMIT_AS, (limit, limit))


def patiently(parameters):
    """They, and what they do not say of PATIENT."""
    return dict(parameters, **{section: dict(values, **parameters.get(section, {})) for section, values in PATIENT.items()})


class NodeRunner(unittest.TestCase):
    """Each test has a folder of its own, in `output`, and hears the odometry."""

    name = "slam_node"  # of the node

    @classmethod
    def setUpClass(cls):
        rospy.init_node(cls.name + "_test")
        cls.publishers = {topic: rospy.Publisher(topic, type(message), queue_size=10000, latch=topic == "/tf_static")
                          for topic, message in drive_data.drive(0.0)}

    def setUp(self):
        self.output = tempfile.mkdtemp(prefix="vi_ekf_slam_%s_" % self.name)
        self.addCleanup(shutil.rmtree, self.output, ignore_errors=True)
        self.odometry = self.listen("odometry", Odometry)

    def listen(self, topic, kind):
        """What is heard there until the test ends, as a list that grows."""
        heard = []
        self.addCleanup(rospy.Subscriber(topic, kind, heard.append, queue_size=10000).unregister)
        return heard

    def set_parameters(self, parameters):
        """Only these are the node's."""
        if rospy.has_param("/" + self.name):
            rospy.delete_param("/" + self.name)
        for key, value in parameters.items():
            rospy.set_param("/%s/%s" % (self.name, key), value)

    def start_node(self, preexec_fn=None, **parameters):
        """Runs slam_node and waits until it listens."""
        self.set_parameters(patiently(parameters))
        self.wait_for(lambda: not any(p.get_num_connections() for p in self.publishers.values()))  # the last one's
        node = subprocess.Popen([drive_data.program("slam_node"), "__name:=" + self.name], stderr=subprocess.DEVNULL,
                                stdout=subprocess.DEVNULL, preexec_fn=preexec_fn)
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

    def answered(self, stamp):
        """Waits for the odometry of this stamp (s)."""
        self.wait_for(lambda: self.odometry and self.odometry[-1].header.stamp.to_sec() >= stamp - 1e-6)

    def play(self, begin, end, start=START, change=None):
        """Publishes what lies between two times (s) of the drive, which began at `start`; `change` is done to the features first."""
        for topic, message in drive_data.drive(end, start):
            if change and topic == "features":
                change(message)
            if begin <= drive_data.stamp_of(message).to_sec() - start or topic == "/tf_static":
                self.publishers[topic].publish(message)
                time.sleep(0.02 if topic == "features" else 0.0)

    def reckon_until(self, condition, start=START):
        """Publishes a drive without features, whose 900 poses are too many for bound_files, until `condition()`."""
        for topic, message in drive_data.drive(90.0, start, calibrated=False):
            if condition():
                break
            if topic in ("imu", "velocity"):
                self.publishers[topic].publish(message)
                time.sleep(0.001)
        self.wait_for(condition)

    def fail_at_a_reset(self, process, has_ended):
        """After 30 s of the drive, by leave_no_memory; the node resumes in it."""
        self.reckon_until(lambda: self.odometry and self.odometry[-1].header.stamp.to_sec() >= START + 30.0)
        leave_no_memory(process)
        self.reckon_until(has_ended, START + 500.0)
