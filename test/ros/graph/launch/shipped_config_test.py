#!/usr/bin/env python3
"""The node starts with a configuration that the package ships: all of it survives the parameter server."""

import sys
import unittest

import rospy
import rostest


class ShippedConfig(unittest.TestCase):
    """A node that refuses its parameters exits before it offers a service."""

    def test_the_node_starts(self):
        """~reset is there, and stays."""
        rospy.init_node("shipped_config_test")
        rospy.wait_for_service("slam/reset", timeout=20.0)
        rospy.sleep(1.0)
        rospy.wait_for_service("slam/reset", timeout=1.0)


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "shipped_config", ShippedConfig, sys.argv)
