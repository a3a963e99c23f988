"""Plays drives to a node, with simulated time, and reads what it answers and reports."""

import math
import time
import unittest

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Empty
from tf2_msgs.msg import TFMessage

import drive_data
from waiting import wait_for

LENGTH = 2.0  # s of the drives
MAX_JUMP_BACK = 1.0  # s, the configuration's


class DrivePlayer(unittest.TestCase):
    """One node; each test plays a drive of its own, later than the one before by more than any gap."""

    next_start = 1000.0

    @classmethod
    def setUpClass(cls):
        rospy.init_node("drive_player")
        cls.odometry, cls.transforms, cls.reports = [], [], []
        cls.subscribers = [rospy.Subscriber("odometry", Odometry, cls.odometry.append, queue_size=10000),
                           rospy.Subscriber("/tf", TFMessage, cls.transforms.append, queue_size=10000),
                           rospy.Subscriber("/diagnostics", DiagnosticArray, cls.reports.append, queue_size=1000)]
        cls.clock = rospy.Publisher("/clock", Clock, queue_size=1000)
        cls.publishers = {topic: rospy.Publisher(topic, type(message), queue_size=10000, latch=topic == "/tf_static")
                          for topic, message in drive_data.drive(0.0)}
        assert wait_for(lambda: all(p.get_num_connections() > 0 for p in cls.publishers.values())), "no listeners"
        assert wait_for(lambda: all(s.get_num_connections() > 0 for s in cls.subscribers)), "no publishers"

    def setUp(self):
        self.start = DrivePlayer.next_start
        DrivePlayer.next_start += 200.0
        rospy.ServiceProxy("slam/reset", Empty)()
        self.before = self.counts()
        self.heard = len(self.odometry), len(self.transforms)

    def counts(self):
        """{key: number} of "dropped" and {key: text} of the others, of a report that is made from now on."""
        known = len(self.reports)
        found = {}

        def complete():
            for report in self.reports[known + 1:]:
                for status in report.status:
                    if status.name.startswith("slam:"):
                        found.update((value.key, value.value) for value in status.values)
                        found[status.name.split(": ")[-1]] = status.level
            return "dropped" in found
        self.assertTrue(wait_for(complete), "no diagnostics")
        return found

    def play(self, messages):
        """Publishes them, the clock with them, slowly enough that connections stay together."""
        for topic, message in messages:
            if topic == "imu":
                self.clock.publish(Clock(message.header.stamp))
            self.publishers[topic].publish(message)
            if topic == "features":
                time.sleep(0.03)

    def drive(self, start=None, duration=LENGTH):
        """A drive's messages in order."""
        return drive_data.drive(duration, self.start if start is None else start)

    def answered(self, stamp):
        """Whether odometry came to have this stamp (s)."""
        return wait_for(lambda: len(self.odometry) > self.heard[0] and
                        self.odometry[-1].header.stamp == rospy.Time.from_sec(stamp))

    def check_counts(self, expected):
        """The counts that have grown since setUp are {key: by how much}, and no others."""
        after = self.counts()
        grown = {}
        for key, value in after.items():
            if ": " in key or key in ("resets", "gaps"):
                if not str(value).isdigit():
                    continue
                growth = int(value) - int(self.before.get(key, 0))
                if growth and "outside" not in key:  # the exact drive has some of those too
                    grown[key] = growth
        self.assertEqual(expected, grown)

    def check_transforms(self, restarts=0):
        """Of each frame, stamps only grow, but for the restarts, which go back far."""
        for child in ("odom", "imu_link"):
            stamps = [t.header.stamp.to_sec() for m in self.transforms[self.heard[1]:] for t in m.transforms
                      if t.child_frame_id == child]
            self.assertTrue(stamps, child)
            back = [(a, b) for a, b in zip(stamps, stamps[1:]) if b <= a]
            self.assertEqual(restarts, len(back), back)
            self.assertTrue(all(a - b > MAX_JUMP_BACK for a, b in back), back)

    def check_pose(self, elapsed, tolerance=0.5):
        """The last odometry is near the circle that is driven."""
        x, y, _ = drive_data.pose_at(elapsed)
        position = self.odometry[-1].pose.pose.position
        self.assertLess(math.hypot(position.x - x, position.y - y), tolerance)
