#!/usr/bin/env python3
"""An estimate that diverges: recovered from, reported and counted."""

import math
import sys

import rostest
from diagnostic_msgs.msg import DiagnosticStatus

import drive_data
from drive_player import LENGTH, DrivePlayer

BACK = 12.0  # m; default.yaml calls a displacement of 10 m, beside the way of two frames, a divergence


class Divergence(DrivePlayer):
    """The node with the default configuration."""

    def test_a_displaced_car(self):
        """Back at once: followed, counted, and an error once."""
        def moved(topic, message):
            time = (message.header.stamp - self.at(0.0)).to_sec() if topic == "features" else 0.0
            return (topic, drive_data.features(message.header.stamp, time, back=BACK)) if time > 1.05 else (topic, message)
        known = len(self.reports)
        self.play([moved(*m) for m in self.drive()])
        self.assertTrue(self.answered(self.start + LENGTH))
        self.check_counts({"diverged: jump": 1})
        x, y, yaw = drive_data.pose_at(LENGTH)
        position = self.odometry[-1].pose.pose.position
        distance = math.hypot(position.x - x + BACK * math.cos(yaw), position.y - y + BACK * math.sin(yaw))
        self.assertLess(distance, 1.0)
        levels = [s.level for r in self.reports[known:] for s in r.status if s.name == "slam: divergence"]
        self.assertEqual(1, levels.count(DiagnosticStatus.ERROR), levels)


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "divergence", Divergence, sys.argv)
