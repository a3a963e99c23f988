#!/usr/bin/env python3
"""Without CameraInfo the node says what is missing, does not crash and still reckons."""

import sys
import time
import unittest

import rospy
import rostest
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log

import drive_data
from vi_ekf_slam.srv import SaveMap
from waiting import wait_for

PERIOD = 5.0  # s of wall time between warnings


class NoCalibration(unittest.TestCase):
    """Live topics without camera_info and /tf_static."""

    def test_clear_warning_and_dead_reckoning(self):
        """The warning names the topic, and comes at most each PERIOD."""
        rospy.init_node("no_calibration_test")
        odometry, warnings = [], []
        rospy.Subscriber("odometry", Odometry, odometry.append, queue_size=1000)
        rospy.Subscriber("/rosout", Log, lambda m: warnings.append(m.msg) if m.level >= Log.WARN else None)
        messages = drive_data.drive(duration=9.0, calibrated=False)
        publishers = {topic: rospy.Publisher(topic, type(message), queue_size=1000) for topic, message in messages}
        self.assertTrue(wait_for(lambda: all(p.get_num_connections() for p in publishers.values())), "nobody listens")
        started = time.monotonic()
        for topic, message in messages:
            publishers[topic].publish(message)
            time.sleep(0.03 if topic == "imu" else 0.0)
        end = drive_data.stamp_of(messages[-1][1])
        self.assertTrue(wait_for(lambda: odometry and odometry[-1].header.stamp == end), len(odometry))

        def named():
            return [w for w in warnings if "left/camera_info" in w and "right/camera_info" in w]
        self.assertTrue(wait_for(named), warnings)
        self.assertLessEqual(len(named()), 2.0 + (time.monotonic() - started) / PERIOD, warnings)
        self.assertGreater(len(odometry), 80)
        travelled = odometry[-1].pose.pose.position.x
        self.assertAlmostEqual(10.5 * 0.974, travelled, delta=0.1)  # sin(1.8) of the radius 2.1 / 0.2
        response = rospy.ServiceProxy("slam/save_map", SaveMap)()
        self.assertFalse(response.success)
        self.assertIn("output_dir", response.message)


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "no_calibration", NoCalibration, sys.argv)
