#!/usr/bin/env python3
"""Live topics into the node: what it publishes, its services, a clock that goes back."""

import math
import os
import subprocess
import sys
import time
import unittest

import numpy as np
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Empty, Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

import drive_data
from vi_ekf_slam.srv import SaveMap
from waiting import wait_for

START = 1000.0


class Live(unittest.TestCase):
    """One node. What it answered to a first drive, and saved of it, is there for all tests; what plays more is its own."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node("live_test")
        cls.heard = {}
        topics = {"odometry": Odometry, "pose": PoseWithCovarianceStamped, "path": Path, "dead_reckoning/path": Path,
                  "landmarks": MarkerArray, "landmark_cloud": PointCloud2, "/tf": TFMessage,
                  "/diagnostics": DiagnosticArray}
        cls.subscribers = []
        for topic, kind in topics.items():
            cls.heard[topic] = []
            cls.subscribers.append(rospy.Subscriber(topic, kind, cls.heard[topic].append, queue_size=10000))
        cls.publishers = {}
        cls.messages = drive_data.drive(start=START, gyro_per_frame=5)
        for topic, message in cls.messages:
            if topic not in cls.publishers:
                cls.publishers[topic] = rospy.Publisher(topic, type(message), queue_size=10000, latch=topic == "/tf_static")
        assert wait_for(lambda: all(p.get_num_connections() > 0 for p in cls.publishers.values())), "no listeners"
        assert wait_for(lambda: all(s.get_num_connections() > 0 for s in cls.subscribers)), "no publishers"
        cls.play(cls.messages)
        cls.end = rospy.Time.from_sec(START + 6.0)
        assert wait_for(lambda: cls.stamps("odometry") and cls.stamps("odometry")[-1] == cls.end), "not answered"
        reports = len(cls.heard["/diagnostics"])
        assert wait_for(lambda: len(cls.heard["/diagnostics"]) > reports + 1), "no diagnostics"  # all is sent by then
        cls.first_drive = {topic: list(messages) for topic, messages in cls.heard.items()}
        cls.saved_trajectory = rospy.ServiceProxy("slam/save_trajectory", Trigger)()
        cls.saved_map = rospy.ServiceProxy("slam/save_map", SaveMap)()
        folder = rospy.get_param("slam/output_dir")
        cls.trajectory = np.loadtxt(os.path.join(folder, "trajectory.tum"))
        cls.landmarks = np.loadtxt(os.path.join(folder, "landmarks.csv"), delimiter=",", skiprows=1)

    @classmethod
    def play(cls, messages):
        """Publishes faster than real time, slowly enough that connections stay within max_delay_s of each other."""
        for topic, message in messages:
            cls.publishers[topic].publish(message)
            if topic == "imu":
                time.sleep(0.01)

    @classmethod
    def stamps(cls, topic):
        """Stamps heard so far."""
        return [message.header.stamp for message in cls.heard[topic]]

    def transforms(self, child):
        """Transforms of the first drive with this child."""
        found = [t for m in self.first_drive["/tf"] for t in m.transforms if t.child_frame_id == child]
        self.assertTrue(found, child)
        return found

    def test_transforms_form_one_tree(self):
        """map -> odom -> imu_link, one parent a frame, every stamp once and in order."""
        for child, parent in (("odom", "map"), ("imu_link", "odom")):
            found = self.transforms(child)
            self.assertEqual({parent}, {t.header.frame_id for t in found})
            stamps = [t.header.stamp for t in found]
            self.assertTrue(all(a < b for a, b in zip(stamps, stamps[1:])), "stamps of %s repeat or go back" % child)

    def test_stamps_are_those_of_the_measurements(self):
        """At the gyro's rate, each stamp once."""
        measured = sorted({drive_data.stamp_of(m) for topic, m in self.messages if topic == "imu"})
        for topic in ("odometry", "pose"):
            self.assertEqual(measured, [m.header.stamp for m in self.first_drive[topic]], topic)
        self.assertEqual(measured, [t.header.stamp for t in self.transforms("odom")])

    def test_odometry_is_corrected_and_agrees_with_the_transforms(self):
        """Pose in map, twist in the child frame, map -> odom -> imu_link the same pose, and the true one."""
        odometry = {m.header.stamp: m for m in self.first_drive["odometry"]}
        map_t_odom = {t.header.stamp: t.transform for t in self.transforms("odom")}
        odom_t_imu = {t.header.stamp: t.transform for t in self.transforms("imu_link")}
        for stamp, message in odometry.items():
            self.assertEqual(("map", "imu_link"), (message.header.frame_id, message.child_frame_id))
            pose = drive_data.matrix(message.pose.pose.position, message.pose.pose.orientation)
            a, b = map_t_odom[stamp], odom_t_imu[stamp]
            chained = drive_data.matrix(a.translation, a.rotation) @ drive_data.matrix(b.translation, b.rotation)
            np.testing.assert_allclose(chained, pose, atol=1e-9)
        last = odometry[self.end]
        self.assertAlmostEqual(drive_data.SPEED + drive_data.SPEED_ERROR, last.twist.twist.linear.x, 6)
        self.assertAlmostEqual(0.0, last.twist.twist.linear.y, 6)
        self.assertAlmostEqual(drive_data.YAW_RATE, last.twist.twist.angular.z, 6)
        x, y, _ = drive_data.pose_at(6.0)
        error = math.hypot(last.pose.pose.position.x - x, last.pose.pose.position.y - y)
        drifted = odom_t_imu[self.end].translation
        drift = math.hypot(drifted.x - x, drifted.y - y)
        self.assertGreater(drift, 0.3)
        self.assertLess(error, 0.5 * drift)

    def test_a_frame_stamp_carries_the_corrected_pose(self):
        """What was published for a frame's stamp is what was saved for that frame."""
        self.assertTrue(self.saved_trajectory.success)
        self.assertEqual(61, len(self.trajectory))
        published = {m.header.stamp.to_sec(): m.pose.pose.position for m in self.first_drive["odometry"]}
        for line in self.trajectory:
            position = published[line[0]]
            np.testing.assert_allclose([position.x, position.y, position.z], line[1:4], atol=1e-8)

    def test_paths_map_and_diagnostics(self):
        """Decimated paths, one list marker, a cloud of the same landmarks, diagnostics without complaint."""
        for topic in ("path", "dead_reckoning/path"):
            path = self.first_drive[topic][-1]
            self.assertEqual("map", path.header.frame_id)
            self.assertTrue(60 < len(path.poses) < 200,  # of 301 samples
                            "%s has %d points" % (topic, len(path.poses)))
        marker = self.first_drive["landmarks"][-1].markers[0]
        self.assertEqual((Marker.POINTS, Marker.ADD), (marker.type, marker.action))
        self.assertGreater(len(marker.points), 20)
        self.assertEqual(len(marker.points), len(marker.colors))
        cloud = self.first_drive["landmark_cloud"][-1]
        self.assertEqual(len(marker.points), cloud.width)
        self.assertEqual(["x", "y", "z", "sigma", "id", "id_high", "log10_sigma"], [field.name for field in cloud.fields])
        names = {status.name.split(": ")[-1] for m in self.first_drive["/diagnostics"] for status in m.status}
        self.assertTrue({"inputs", "calibration", "estimator", "dropped"} <= names, names)
        keys = {value.key for m in self.first_drive["/diagnostics"] for status in m.status for value in status.values}
        self.assertTrue({"noise of gyro", "noise of velocity", "noise of pixels"} <= keys, keys)

    def test_save_map(self):
        """One line a landmark; the paper's filter has no joint covariance, so that no map.bag is written."""
        self.assertFalse(self.saved_map.success)
        self.assertIn("map.bag", self.saved_map.message)
        self.assertGreater(len(self.landmarks), 20)

    def test_a_clock_that_goes_back_starts_anew(self):
        """Markers are deleted, paths begin again, transforms go on with the old stamps."""
        for start in (START + 500.0, START - 500.0):
            before = {topic: len(messages) for topic, messages in self.heard.items()}
            self.play([m for m in drive_data.drive(2.0, start) if m[0] != "/tf_static"])
            end = rospy.Time.from_sec(start + 2.0)
            self.assertTrue(wait_for(lambda: self.stamps("odometry")[-1] == end))
        actions = [marker.action for m in self.heard["landmarks"][before["landmarks"]:] for marker in m.markers]
        self.assertIn(Marker.DELETEALL, actions)
        path = self.heard["path"][-1]
        self.assertLess(max(p.header.stamp for p in path.poses), rospy.Time.from_sec(START))
        self.assertTrue(wait_for(lambda: end in [t.header.stamp for m in self.heard["/tf"][before["/tf"]:]
                                                 for t in m.transforms]))  # /tf and odometry come on their own ways

    def test_reset_service(self):
        """Everything starts anew when asked to."""
        before = len(self.heard["landmarks"])
        rospy.ServiceProxy("slam/reset", Empty)()
        self.assertTrue(wait_for(lambda: len(self.heard["landmarks"]) > before))
        self.assertEqual(Marker.DELETEALL, self.heard["landmarks"][-1].markers[0].action)

    def test_a_bad_parameter_keeps_the_node_from_starting(self):
        """Key, value and what is allowed are named; the exit code says so too."""
        for key, value in (("paper/pixel_noise", -1.0), ("paper/pixel_nois", 1.0), ("ros/map_frame", "/map")):
            name = "bad_" + key.replace("/", "_")
            rospy.set_param("/%s/%s" % (name, key), value)
            done = subprocess.run([drive_data.program("slam_node"), "__name:=" + name], check=False, timeout=20.0,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            log = done.stdout.decode()
            self.assertNotEqual(0, done.returncode, log)
            self.assertIn(key.split("/")[1], log)


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "live", Live, sys.argv)
