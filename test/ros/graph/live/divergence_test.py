#!/usr/bin/env python3
"""The node with the default configuration: an estimate that diverges, and tuning while it runs."""

import math
import sys

import dynamic_reconfigure.client
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Path

import drive_data
from drive_player import LENGTH, DrivePlayer

BACK = 12.0  # m; a displacement of 10 m, beside the way of two frames, is a divergence
JUMP = 1.05  # s after the start


class Divergence(DrivePlayer):
    """What takes the default estimator."""

    def test_a_displaced_car(self):
        """Back at once: followed, counted, and an error once."""
        yaw = drive_data.pose_at(JUMP)[2]
        offset = -BACK * math.cos(yaw), -BACK * math.sin(yaw)

        def moved(topic, message):
            time = message.header.stamp.to_sec() - self.start if topic == "features" else 0.0
            return (topic, drive_data.features(message.header.stamp, time, offset) if time > JUMP else message)
        known = len(self.reports)
        self.play([moved(*m) for m in self.drive()])
        self.assertTrue(self.answered(self.start + LENGTH))
        self.check_counts({"diverged: jump": 1})
        x, y, _ = drive_data.pose_at(LENGTH)
        position = self.odometry[-1].pose.pose.position
        distance = math.hypot(position.x - x - offset[0], position.y - y - offset[1])
        self.assertLess(distance, 1.0)
        levels = [s.level for r in self.reports[known:] for s in r.status if s.name == "slam: divergence"]
        self.assertEqual(1, levels.count(DiagnosticStatus.ERROR), levels)

    def test_gates_and_rates_change_while_it_runs(self):
        """By dynamic_reconfigure: with a gate that nothing passes frames are rejected, as long as it is there."""
        paths = []
        subscriber = rospy.Subscriber("path", Path, paths.append, queue_size=100)
        tuning = dynamic_reconfigure.client.Client("slam/tuning", timeout=10.0)
        configured = tuning.get_configuration(timeout=10.0)
        self.assertEqual((5.0, 0.5), (configured["frame_gate"], configured["path_period_s"]))
        self.addCleanup(tuning.update_configuration, {"frame_gate": 5.0, "path_period_s": 0.5})

        changed = tuning.update_configuration({"frame_gate": 1e-6, "path_period_s": 1000.0})
        self.assertEqual((1e-6, 1000.0), (changed["frame_gate"], changed["path_period_s"]))
        self.assertEqual(1e-6, tuning.update_configuration({"frame_gate": float("nan")})["frame_gate"])
        before = int(self.before["frames rejected"])
        self.play(self.drive())
        self.assertTrue(self.answered(self.start + LENGTH))
        closed = int(self.counts()["frames rejected"]) - before
        self.assertGreater(closed, 15)
        seldom = len(paths)

        tuning.update_configuration({"frame_gate": 5.0, "path_period_s": 0.1})
        self.play(self.drive(start=self.start + 100.0))
        self.assertTrue(self.answered(self.start + 100.0 + LENGTH))
        self.assertEqual(closed, int(self.counts()["frames rejected"]) - before)
        self.assertGreater(len(paths) - seldom, seldom + 5)
        subscriber.unregister()


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "divergence", Divergence, sys.argv)
