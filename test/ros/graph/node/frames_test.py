#!/usr/bin/env python3
"""The node among other publishers of transforms: one tree, one parent for each frame, and poses that agree with it."""

import math
import subprocess
import sys
import time

import numpy as np
import rospy
import rostest
import tf2_ros
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from roslib.packages import find_node
from rosgraph_msgs.msg import Log
from std_srvs.srv import Empty, Trigger
from tf2_msgs.msg import TFMessage

import drive_data
from node_runner import START, WITHOUT_SLIP, NodeRunner

URDF = """<robot name="cart"><link name="base_link"/><link name="imu_link"/><link name="left_camera_optical"/>
<joint name="imu" type="fixed"><parent link="base_link"/><child link="imu_link"/>
<origin xyz="0.3 -0.2 0.9" rpy="0 0 1.5707963267948966"/></joint>
<joint name="camera" type="fixed"><parent link="imu_link"/><child link="left_camera_optical"/>
<origin xyz="0.4 0.2 0.1" rpy="-1.5707963267948966 0 -1.5707963267948966"/></joint></robot>"""
# m/s and rad/s of odometry that drifts; not what the drive does
FOREIGN_SPEED, FOREIGN_RATE = 2.4, 0.26


def pose_of(odometry):
    """4x4."""
    return drive_data.matrix(odometry.pose.pose.position, odometry.pose.pose.orientation)


def foreign_transform(stamp):
    """odom -> base_link of another odometry."""
    elapsed = stamp.to_sec() - START
    message = TransformStamped()
    message.header.stamp, message.header.frame_id, message.child_frame_id = stamp, "odom", drive_data.BASE
    message.transform.translation.x = FOREIGN_SPEED * elapsed
    message.transform.rotation.z = math.sin(0.5 * FOREIGN_RATE * elapsed)
    message.transform.rotation.w = math.cos(0.5 * FOREIGN_RATE * elapsed)
    return TFMessage([message])


class Frames(NodeRunner):
    """Each test has a node of its own and hears all transforms."""

    name = "slam_frames"

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.tf = rospy.Publisher("/tf", TFMessage, queue_size=10000)

    def setUp(self):
        super().setUp()
        self.dynamic = self.listen("/tf", TFMessage)
        self.reckoned = self.listen("dead_reckoning/odometry", Odometry)
        self.said = self.listen("/rosout", Log)

    def start_node(self, **parameters):
        """Told that the tracks of this drive do not slip."""
        node = super().start_node(invariant=WITHOUT_SLIP, **parameters)
        self.static = self.listen("/tf_static", TFMessage)  # not before: it would be taken for the node's
        return node

    def warned(self, *words):
        """Waits for a warning with all of them."""
        self.wait_for(lambda: any(m.level >= Log.WARN and all(word in m.msg for word in words) for m in self.said))

    def run_program(self, package, program):
        """Beside the node, to its end."""
        process = subprocess.Popen([find_node(package, program)[0]], stdout=subprocess.DEVNULL)
        self.addCleanup(process.wait)
        self.addCleanup(process.terminate)

    def describe_robot(self):
        """robot_state_publisher with base_link -> imu_link -> left_camera_optical."""
        rospy.set_param("/robot_description", URDF)
        self.addCleanup(rospy.delete_param, "/robot_description")
        self.run_program("robot_state_publisher", "robot_state_publisher")

    def drive(self, begin, end, described=True, each=None):
        """Publishes a part of the drive; with `described` the robot's description alone knows what is static."""
        for topic, message in drive_data.drive(end):
            stamp = drive_data.stamp_of(message)
            if stamp.to_sec() - START < begin or (described and topic == "/tf_static"):
                continue
            self.publishers[topic].publish(message)
            if topic == "imu" and each:
                each(stamp)
            time.sleep(0.02 if topic == "features" else 0.0)

    def corrected(self):
        """Stamps of map -> odom."""
        return {t.header.stamp for m in self.dynamic for t in m.transforms if t.header.frame_id == "map"}

    def check_tree(self, expected):
        """The tree, once all its frames were heard."""
        self.wait_for(lambda: {t.child_frame_id for m in self.dynamic + self.static for t in m.transforms} == set(expected))
        self.assertEqual(expected, self.tree())

    def tree(self):
        """{child: parent}, what view_frames draws; fails unless each has one, and all have one root."""
        parents = {}
        for message in self.dynamic + self.static:
            for transform in message.transforms:
                parents.setdefault(transform.child_frame_id, set()).add(transform.header.frame_id)
        self.assertTrue(all(len(found) == 1 for found in parents.values()), parents)
        tree = {child: found.pop() for child, found in parents.items()}
        self.assertEqual(1, len(set(tree.values()) - set(tree)), tree)
        return tree

    def buffer(self):
        """All transforms that were heard."""
        buffer = tf2_ros.BufferCore(rospy.Duration(1000.0))
        for messages, add in ((self.static, buffer.set_transform_static), (self.dynamic, buffer.set_transform)):
            for message in messages:
                for transform in message.transforms:
                    add(transform, "test")
        return buffer

    def check_chain(self, tolerance=1e-6):
        """map -> ... -> the frame of the odometry is its pose at each stamp that has a map -> odom."""
        odometry = list(self.odometry)
        self.wait_for(lambda: len(self.corrected() & {m.header.stamp for m in odometry}) > 30)
        corrected, buffer = self.corrected(), self.buffer()
        for message in odometry:
            if message.header.stamp not in corrected:
                continue
            found = buffer.lookup_transform_core("map", message.child_frame_id, message.header.stamp).transform
            np.testing.assert_allclose(drive_data.matrix(found.translation, found.rotation), pose_of(message),
                                       atol=tolerance)

    def check_base(self):
        """The odometry is of the base, in a map that begins where the base began, and its twist is the base's."""
        for message in self.odometry:
            self.assertEqual(("map", drive_data.BASE), (message.header.frame_id, message.child_frame_id))
        last = self.odometry[-1]
        x, y, z, yaw = drive_data.base_of(*drive_data.pose_at(last.header.stamp.to_sec() - START))
        pose = pose_of(last)
        np.testing.assert_allclose(pose[:3, 3], (x, y, z), atol=0.2)
        self.assertAlmostEqual(yaw, math.atan2(pose[1, 0], pose[0, 0]), delta=0.03)
        expected = drive_data.base_velocity(last.header.stamp).twist.twist.linear
        twist = last.twist.twist
        np.testing.assert_allclose((twist.linear.x, twist.linear.y), (expected.x, expected.y), atol=0.15)
        self.assertAlmostEqual(drive_data.YAW_RATE, twist.angular.z, delta=0.02)

    def test_alone(self):
        """map -> odom -> imu_link -> camera."""
        self.start_node()
        self.drive(0.0, 4.0, described=False)
        self.answered(START + 3.7)
        self.check_tree({"odom": "map", "imu_link": "odom", drive_data.LEFT: "imu_link"})
        self.check_chain()

    def check_tree_with_base(self):
        """One chain over base_link, whoever publishes odom -> base_link, and poses of that."""
        self.check_tree({"odom": "map", drive_data.BASE: "odom", "imu_link": drive_data.BASE, drive_data.LEFT: "imu_link"})
        self.check_chain()
        self.check_base()

    def test_with_a_robot_description(self):
        """odom -> base_link, and poses of that; imu_link keeps its parent."""
        self.describe_robot()
        self.start_node(ros={"base_frame": drive_data.BASE})
        self.drive(0.0, 5.0)
        self.answered(START + 4.7)
        self.check_tree_with_base()

    def test_with_a_robot_description_that_it_was_not_told_of(self):
        """No second parent of imu_link; what to do is said."""
        self.describe_robot()
        self.start_node()
        self.drive(0.0, 4.0)
        self.answered(START + 3.7)
        self.warned("base_frame", "'base_link'")
        self.check_tree({"imu_link": drive_data.BASE, drive_data.LEFT: "imu_link"})

    def test_with_foreign_odometry(self):
        """map -> odom makes up for what the other odometry is off by, whatever it is, at its own stamps."""
        self.describe_robot()
        self.start_node(ros={"base_frame": drive_data.BASE, "publish_odom_tf": False})
        self.drive(0.0, 5.0, each=lambda stamp: self.tf.publish(foreign_transform(stamp)))
        self.answered(START + 4.7)
        self.check_tree_with_base()
        self.assertFalse(self.reckoned)  # its odom is not the other's

    def test_foreign_odometry_that_it_was_not_told_of(self):
        """No second publisher of odom -> base_link; what to do is said."""
        self.describe_robot()
        self.start_node(ros={"base_frame": drive_data.BASE})
        self.tf.publish(foreign_transform(rospy.Time.from_sec(START)))
        self.wait_for(lambda: self.dynamic)  # it is sent, and an answer of the node says that the node has read it
        rospy.ServiceProxy("/%s/save_trajectory" % self.name, Trigger)()
        foreign = [foreign_transform(rospy.Time.from_sec(START))]

        def publish(stamp):
            foreign.append(foreign_transform(stamp))
            self.tf.publish(foreign[-1])
        self.drive(0.0, 4.0, each=publish)
        self.answered(START + 3.7)
        self.warned("publish_odom_tf", "'odom' -> 'base_link'")
        self.wait_for(lambda: len(self.dynamic) >= len(foreign))
        self.assertEqual(foreign, list(self.dynamic))
        self.check_tree({drive_data.BASE: "odom", "imu_link": drive_data.BASE, drive_data.LEFT: "imu_link"})

    def test_foreign_odometry_that_does_not_come_is_missed(self):
        """Loudly; nothing is made up in its place."""
        self.describe_robot()
        self.start_node(ros={"base_frame": drive_data.BASE, "publish_odom_tf": False})
        for topic, message in drive_data.drive(4.0, gyro_per_frame=10):
            if topic != "/tf_static":
                self.publishers[topic].publish(message)
                time.sleep(0.002)
        self.answered(START + 3.7)
        self.warned("publish_odom_tf is false")
        self.assertFalse(self.corrected())

    def test_as_odometry_for_another_localisation(self):
        """odom -> base_link alone, so that map -> odom is the other's."""
        self.describe_robot()
        self.start_node(ros={"base_frame": drive_data.BASE, "publish_map_tf": False})
        self.drive(0.0, 3.0)
        self.answered(START + 2.7)
        self.check_tree({drive_data.BASE: "odom", "imu_link": drive_data.BASE, drive_data.LEFT: "imu_link"})

    def test_another_localisation_that_it_was_not_told_of(self):
        """No second publisher of map -> odom, and odom -> imu_link goes on; what to do is said."""
        self.start_node()
        foreign = TransformStamped()
        foreign.header.frame_id, foreign.child_frame_id = "map", "odom"
        foreign.transform.translation.x = foreign.transform.rotation.w = 1.0

        def publish(stamp):
            foreign.header.stamp = stamp
            self.tf.publish(TFMessage([foreign]))
        publish(rospy.Time.from_sec(START))
        self.wait_for(lambda: self.dynamic)
        rospy.ServiceProxy("/%s/save_trajectory" % self.name, Trigger)()  # answered: the node has read it
        self.drive(0.0, 4.0, described=False, each=publish)
        self.answered(START + 3.7)
        self.warned("publish_map_tf", "'map' -> 'odom'")
        of_odom = [t for m in self.dynamic for t in m.transforms if t.child_frame_id == "odom"]
        self.assertEqual({1.0}, {t.transform.translation.x for t in of_odom})
        self.check_tree({"odom": "map", "imu_link": "odom", drive_data.LEFT: "imu_link"})

    def test_the_odometry_in_odom_never_jumps(self):
        """Not by corrections, and not by a reset, by which the one in map does; it is what /tf says of odom."""
        self.start_node(ros={"transform_tolerance": 0.3})
        self.drive(0.0, 3.0, described=False)
        self.answered(START + 2.7)
        before = pose_of(self.odometry[-1])
        rospy.ServiceProxy("/%s/reset" % self.name, Empty)()
        self.drive(3.1, 6.0, described=False)
        self.answered(START + 5.7)
        steps = [np.linalg.norm((np.linalg.inv(pose_of(a)) @ pose_of(b))[:3, 3])
                 for a, b in zip(self.reckoned, self.reckoned[1:])]
        self.assertGreater(len(steps), 50)
        self.assertLess(max(steps), 0.5)  # 0.2 m in 0.1 s, and the step over the reset
        self.assertGreater(np.linalg.norm(before[:3, 3]), 5.0)
        jumps = [np.linalg.norm((pose_of(b) - pose_of(a))[:3, 3]) for a, b in zip(self.odometry, self.odometry[1:])]
        self.assertGreater(max(jumps), 5.0)
        buffer = self.buffer()
        for message in self.reckoned:
            self.assertEqual(("odom", "imu_link"), (message.header.frame_id, message.child_frame_id))
            found = buffer.lookup_transform_core("odom", "imu_link", message.header.stamp).transform
            np.testing.assert_allclose(drive_data.matrix(found.translation, found.rotation), pose_of(message), atol=1e-9)
        sigma = [math.sqrt(m.pose.covariance[0]) for m in self.reckoned]
        self.assertTrue(all(a <= b * (1.0 + 1e-9) for a, b in zip(sigma[1:20], sigma[2:21])), sigma)
        later = [t.header.stamp.to_sec() for m in self.dynamic for t in m.transforms if t.header.frame_id == "map"]
        measured = {round(m.header.stamp.to_sec() + 0.3, 6) for m in self.odometry}
        self.assertTrue(all(round(stamp, 6) in measured for stamp in later), later[:5])


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "frames", Frames, sys.argv)
