#!/usr/bin/env python3
"""What a vehicle that is put elsewhere can say, and what the node starts with."""

import math
import os
import sys
import time

import dynamic_reconfigure.client
import rospy
import rostest
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from nav_msgs.msg import Path
from rosgraph_msgs.msg import Log

import drive_data
from node_runner import START, WITHOUT_SLIP, NodeRunner
from vi_ekf_slam.srv import LoadMap, SaveMap, SetPose


def told(x, y, yaw, variance=0.04, frame="map"):
    """A pose as rviz sends it: no variance of height, roll and pitch."""
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    message.pose.covariance = [variance if i in (0, 7, 35) else 0.0 for i in range(36)]
    return message


class ServicesTest(NodeRunner):
    """A node of its own for each test."""

    name = "slam_services"

    def setUp(self):
        super().setUp()
        self.paths = self.listen("path", Path)
        self.said = self.listen("/rosout", Log)

    def start_node(self, **parameters):
        """Told that the tracks of this drive do not slip."""
        return super().start_node(invariant=WITHOUT_SLIP, **parameters)

    def service(self, name, kind):
        """A private service."""
        name = "/%s/%s" % (self.name, name)
        rospy.wait_for_service(name, timeout=20.0)
        return rospy.ServiceProxy(name, kind)

    def pose(self):
        """(x, y, yaw) of the last odometry."""
        pose = self.odometry[-1].pose.pose
        return pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)

    def check_pose(self, expected, tolerance=0.4):
        """The last odometry."""
        x, y, yaw = self.pose()
        self.assertLess(math.hypot(x - expected[0], y - expected[1]), tolerance, (self.pose(), expected))
        self.assertAlmostEqual(expected[2], yaw, delta=0.1)

    def test_a_vehicle_is_told_where_it_is(self):
        """By service and by topic: the next poses go on from there, as sure as was said."""
        self.start_node()
        self.play(0.0, 3.0)
        self.answered(START + 2.7)
        set_pose = self.service("set_pose", SetPose)
        answer = set_pose(told(100.0, 50.0, 1.0))
        self.assertTrue(answer.success, answer.message)
        self.play(3.1, 3.3)
        self.answered(START + 3.1)
        x, y, yaw = self.pose()
        self.assertLess(math.hypot(x - 100.0, y - 50.0), 2.0)
        self.assertAlmostEqual(1.0, yaw, delta=0.15)
        covariance = self.odometry[-1].pose.covariance
        self.assertAlmostEqual(0.04, covariance[0], delta=0.03)
        self.assertAlmostEqual(0.01, covariance[14], delta=0.01)  # of what was not said
        self.play(3.4, 5.0)  # it drives on, by features too
        self.answered(START + 4.7)
        travelled = math.hypot(self.pose()[0] - 100.0, self.pose()[1] - 50.0)
        self.assertAlmostEqual(4.0, travelled, delta=1.0)
        late = told(0.0, 0.0, 0.0)
        late.header.stamp = rospy.Time.from_sec(START + 3.7)  # since when it has driven on
        before = self.odometry[-1].header.stamp.to_sec()
        self.assertTrue(set_pose(late).success)
        self.play(5.05, 5.1)
        self.answered(START + 4.9)
        elapsed = self.odometry[-1].header.stamp.to_sec() - (START + 3.7)
        self.assertGreater(before - START, 4.5)
        self.assertAlmostEqual((drive_data.SPEED + drive_data.SPEED_ERROR) * elapsed, self.pose()[0], delta=0.4)
        publisher = rospy.Publisher("initialpose", PoseWithCovarianceStamped, queue_size=1)
        self.wait_for(lambda: publisher.get_num_connections() > 0)
        before = len(self.said)
        publisher.publish(told(-20.0, 0.0, 0.0))
        self.wait_for(lambda: any("the pose is set" in m.msg for m in self.said[before:]))
        self.play(5.1, 6.0)
        self.answered(START + 5.7)
        self.assertLess(math.hypot(self.pose()[0] + 20.0, self.pose()[1]), 3.0)

    def test_what_is_no_pose_is_refused(self):
        """Named, with what is allowed; the estimate goes on."""
        self.start_node()
        set_pose = self.service("set_pose", SetPose)
        self.assertIn("no imu message", set_pose(told(0.0, 0.0, 0.0)).message)
        self.publishers["imu"].publish(drive_data.imu(rospy.Time.from_sec(START)))
        self.wait_for(lambda: "no imu message" not in set_pose(told(0.0, 0.0, 0.0)).message)
        self.assertIn("not started: no measurement", set_pose(told(0.0, 0.0, 0.0)).message)
        self.play(0.0, 2.0)
        self.answered(START + 1.7)
        for wrong, part in ((told(1.0, 2.0, 3.0, frame="odom"), "'odom', allowed: the map's frame 'map'"),
                            (told(float("nan"), 2.0, 3.0), "pose.position"),
                            (told(1.0, 2.0, 3.0, variance=-1.0), "pose.covariance"),
                            (PoseWithCovarianceStamped(), "header.frame_id")):
            answer = set_pose(wrong)
            self.assertFalse(answer.success)
            self.assertIn(part, answer.message)
        wrong = told(1.0, 2.0, 3.0)
        wrong.pose.pose.orientation.w = 7.0
        self.assertIn("pose.orientation", set_pose(wrong).message)
        self.play(2.1, 3.0)
        self.answered(START + 2.7)
        self.check_pose(drive_data.pose_at(self.odometry[-1].header.stamp.to_sec() - START))

    def test_a_vehicle_is_told_where_it_is_in_a_loaded_map(self):
        """Then poses are in the map's frame at once, and ids that return make them as good as the map."""
        path = os.path.join(self.output, "map.bag")
        node = self.start_node()
        self.play(0.0, 8.0)
        self.answered(START + 7.7)
        answer = self.service("save_map", SaveMap)(path)
        self.assertTrue(answer.success, answer.message)
        node.terminate()
        node.wait(20)
        del self.odometry[:]
        self.start_node()
        self.assertTrue(self.service("load_map", LoadMap)(path).success)
        start = START + 500.0
        self.play(4.0, 4.2, start)  # too few frames to be found by them
        self.answered(start + 4.0)
        self.assertLess(abs(self.pose()[0]), 1.0)
        x, y, yaw = drive_data.pose_at(4.2)
        answer = self.service("set_pose", SetPose)(told(x + 0.3, y - 0.2, yaw))
        self.assertTrue(answer.success, answer.message)
        self.play(4.3, 4.4, start)
        self.answered(start + 4.3)
        self.check_pose(drive_data.pose_at(self.odometry[-1].header.stamp.to_sec() - start), 0.8)
        self.wait_for(lambda: self.paths and self.paths[-1].poses and self.paths[-1].poses[0].pose.position.x > 5.0)
        self.play(4.5, 7.0, start)
        self.answered(start + 6.7)
        self.check_pose(drive_data.pose_at(self.odometry[-1].header.stamp.to_sec() - start), 0.3)

    def test_biases_that_are_told_late_count_from_the_first_sample(self):
        """Each topic has a connection of its own, so that what is published first may come last."""
        bias = TwistWithCovarianceStamped()
        bias.header.stamp, bias.header.frame_id = rospy.Time.from_sec(START), drive_data.IMU
        bias.twist.twist.angular.z = 0.5
        bias.twist.covariance = [1e-8 if i % 7 == 0 else 0.0 for i in range(36)]
        publisher = rospy.Publisher("twist_bias", TwistWithCovarianceStamped, queue_size=1)
        self.addCleanup(publisher.unregister)
        self.start_node(buffer={"max_delay_s": 0.1})
        self.wait_for(lambda: publisher.get_num_connections() > 0)

        def see_nothing(message):
            message.features = []
        self.play(0.0, 0.6, change=see_nothing)
        time.sleep(0.5)
        self.assertFalse(self.odometry)
        publisher.publish(bias)
        self.play(0.7, 2.0, change=see_nothing)
        self.answered(START + 1.8)
        elapsed = self.odometry[-1].header.stamp.to_sec() - START
        self.assertAlmostEqual((drive_data.YAW_RATE - 0.5) * elapsed, self.pose()[2], delta=0.05)

    def test_stored_rates_and_gates_are_those_that_it_starts_with(self):
        """As for every server of dynamic_reconfigure; the rest is the configuration's."""
        self.set_parameters({})
        node = self.start_node(tuning={"frame_gate": 3.0}, ros={"path_period_s": 0.25})
        client = dynamic_reconfigure.client.Client(self.name + "/tuning", timeout=10.0)
        values = client.get_configuration(timeout=10.0)
        self.assertEqual((3.0, 0.25), (values["frame_gate"], values["path_period_s"]))
        client.update_configuration({"path_period_s": 2.0})
        client.close()
        node.terminate()
        node.wait(20)
        stored = rospy.get_param("/%s/tuning" % self.name)
        self.assertEqual((3.0, 2.0), (stored["frame_gate"], stored["path_period_s"]))
        self.start_node(tuning=stored, ros={"path_period_s": 0.25})
        client = dynamic_reconfigure.client.Client(self.name + "/tuning", timeout=10.0)
        self.assertEqual(2.0, client.get_configuration(timeout=10.0)["path_period_s"])
        client.close()

    def test_what_is_stored_there_and_no_number_is_refused(self):
        """With its name."""
        for value in ("much", float("nan"), [1.0], True):
            self.assertIn("/%s/tuning/gate must be a finite number" % self.name, self.refused(tuning={"gate": value}))


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "services", ServicesTest, sys.argv)
