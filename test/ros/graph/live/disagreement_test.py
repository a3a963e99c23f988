#!/usr/bin/env python3
"""A sensor that moves the body otherwise than the pictures do is named by the node, in the log and in /diagnostics."""

import sys

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticStatus
from rosgraph_msgs.msg import Log

from drive_player import DrivePlayer
from waiting import wait_for

LONG_ENOUGH = 14.0  # s; ten windows of a second contradict, and some pass before
COMPLAINT = "the gyro does not turn as the pictures do"
ADVICE = "are the gyro's axes those of the transform to the camera"


class Disagreement(DrivePlayer):
    """One fault a node: what is judged already stays."""

    def test_a_gyro_of_the_other_sign(self):
        """Named once in the log, and for as long as the node runs in /diagnostics."""
        logged = []
        subscriber = rospy.Subscriber("/rosout", Log, lambda entry: logged.append(entry.msg))
        self.addCleanup(subscriber.unregister)
        self.assertTrue(wait_for(lambda: subscriber.get_num_connections() > 0))
        messages = self.drive(duration=LONG_ENOUGH)
        for k, message in enumerate(message for topic, message in messages if topic == "imu"):
            message.angular_velocity.z *= -1.0 + 1e-3 * (k % 2)  # the same number all along would be another fault
        known = len(self.reports)
        self.play(messages)

        def inputs():
            return [s for r in self.reports[known:] for s in r.status if s.name == "slam: inputs"]
        self.assertTrue(wait_for(lambda: COMPLAINT in inputs()[-1].message), inputs()[-1].message)
        self.assertEqual(DiagnosticStatus.WARN, inputs()[-1].level)
        self.assertNotIn(COMPLAINT, inputs()[0].message)
        self.assertTrue(wait_for(lambda: any(COMPLAINT in text for text in logged)), logged)
        self.assertEqual(1, sum(COMPLAINT in text for text in logged))
        self.assertIn(ADVICE, inputs()[-1].message)


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "disagreement", Disagreement, sys.argv)
