#!/usr/bin/env python3
"""The node starts with a configuration that the package ships: all of it survives the parameter server."""

import sys
import unittest

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Empty

from waiting import wait_for


class ShippedConfig(unittest.TestCase):
    """A node that refuses its parameters exits before it offers a service."""

    def test_the_node_starts(self):
        """It offers ~reset, does it, and reports after that."""
        rospy.init_node("shipped_config_test")
        rospy.wait_for_service("slam/reset", timeout=20.0)
        rospy.ServiceProxy("slam/reset", Empty)()
        reports = []
        rospy.Subscriber("/diagnostics", DiagnosticArray, reports.append)
        self.assertTrue(wait_for(lambda: any(s.name.startswith("slam: ") for r in reports for s in r.status)), reports)


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "shipped_config", ShippedConfig, sys.argv)
