#!/usr/bin/env python3
"""A live node with an IMU of 400 Hz that has accelerometers, and without a velocity."""

import math
import os
import sys
import time

import numpy as np
import rospy
import rostest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from tf2_msgs.msg import TFMessage

import drive_data
import inertial_drive
from node_runner import START, WITHOUT_SLIP, NodeRunner
from vi_ekf_slam.srv import SetPose, SetState

MOVING = 4.0  # s of the drive, at full speed


class InertialTest(NodeRunner):
    """A node of its own for each test."""

    name = "slam_inertial"

    def setUp(self):
        super().setUp()
        self.reports = self.listen("/diagnostics", DiagnosticArray)
        self.transforms = self.listen("/tf", TFMessage)
        self.said = self.listen("/rosout", Log)
        self.dead_reckoning = self.listen("dead_reckoning/odometry", Odometry)

    def start_node(self, **parameters):
        """Its poses are those of the base, unless said otherwise."""
        parameters.setdefault("ros", {"base_frame": drive_data.BASE})
        return super().start_node(invariant=WITHOUT_SLIP, **parameters)

    def feed(self, messages):
        """Publishes them, faster than real time."""
        for topic, message in messages:
            self.publishers[topic].publish(message)
            time.sleep(0.03 if topic == "features" else 0.0)

    def report(self, name, condition=lambda status: True):
        """The status of that name, of a report that is made from now on, for which `condition` holds."""
        known = len(self.reports)

        def found():
            return [s for report in self.reports[known + 1:] for s in report.status
                    if s.name == "%s: %s" % (self.name, name) and condition(s)]
        self.wait_for(found)
        return found()[-1]

    def check_level(self, first=0):
        """Of all odometry the z axis points up and the height is 0."""
        self.assertGreater(len(self.odometry), first)
        for message in self.odometry[first:]:
            matrix = drive_data.matrix(message.pose.pose.position, message.pose.pose.orientation)
            self.assertGreater(matrix[2, 2], math.cos(0.02))
            self.assertLess(abs(matrix[2, 3]), 0.1)

    def check_motion(self, seconds):
        """From where it was `seconds` before the end it has moved as it did."""
        last = self.odometry[-1]
        then = next(m for m in self.odometry if (last.header.stamp - m.header.stamp).to_sec() <= seconds + 1e-6)
        a, b = (drive_data.matrix(m.pose.pose.position, m.pose.pose.orientation) for m in (then, last))
        moved = np.linalg.inv(a) @ b
        (x0, y0, yaw0), (x, y, yaw) = (inertial_drive.pose_at(m.header.stamp.to_sec() - START) for m in (then, last))
        c, s = math.cos(yaw0), math.sin(yaw0)
        expected = c * (x - x0) + s * (y - y0), c * (y - y0) - s * (x - x0)
        np.testing.assert_allclose(moved[:2, 3], expected, atol=0.15)
        self.assertAlmostEqual(yaw - yaw0, math.atan2(moved[1, 0], moved[0, 0]), delta=0.02)
        self.assertAlmostEqual(drive_data.SPEED, last.twist.twist.linear.x, delta=0.1)

    def test_from_rest(self):
        """It starts by itself before it moves, in a level map; TF and odometry agree, diagnostics have no complaint."""
        self.start_node()
        self.feed(inertial_drive.drive(0.0, 6.0, START))
        self.answered(START + 5.9)
        self.assertLess(self.odometry[0].header.stamp.to_sec(), START + inertial_drive.REST + 1.0)
        self.check_level()
        self.check_motion(3.0)
        last = self.odometry[-1]
        x, y, yaw = inertial_drive.pose_at(last.header.stamp.to_sec() - START)
        position = last.pose.pose.position
        np.testing.assert_allclose((position.x, position.y), (x, y), atol=0.2)
        self.assertAlmostEqual(yaw, 2.0 * math.atan2(last.pose.pose.orientation.z, last.pose.pose.orientation.w), delta=0.02)
        steps = [(b.header.stamp - a.header.stamp).to_sec() for a, b in zip(self.odometry, self.odometry[1:])]
        self.assertAlmostEqual(1.0 / inertial_drive.RATE, np.median(steps), 6)

        def transform(child):
            return [t.transform for m in self.transforms for t in m.transforms
                    if t.child_frame_id == child and t.header.stamp == last.header.stamp]
        self.wait_for(lambda: transform("odom") and transform(drive_data.BASE))
        a, b = (drive_data.matrix(t.translation, t.rotation) for t in (transform("odom")[0], transform(drive_data.BASE)[0]))
        np.testing.assert_allclose(a @ b, drive_data.matrix(position, last.pose.pose.orientation), atol=1e-9)

        status = self.report("estimator")
        values = {value.key: value.value for value in status.values}
        self.assertEqual(DiagnosticStatus.OK, status.level, status)
        self.assertIn("inertial, the IMU's messages carry accelerations", values["motion"])
        self.assertGreater(int(values["frames before the start"]), 0)
        for sensor, density in zip(("gyro", "accelerometer"), inertial_drive.DENSITIES):
            self.assertTrue(values["noise of " + sensor].startswith("%s %g " % (sensor, density)), values)
            self.assertIn("from its messages' covariance at 400 Hz", values["noise of " + sensor])
        self.assertNotIn("velocity", self.report("inputs").message)
        self.assertTrue(any("motion: inertial" in m.msg for m in self.said))
        self.assertTrue(any(m.msg == "started" for m in self.said))

    def test_in_motion(self):
        """It starts by itself at full speed too, and the map is level."""
        self.start_node()
        self.feed(inertial_drive.drive(MOVING, MOVING + 5.0, START))
        self.answered(START + MOVING + 4.9)
        self.check_level()
        self.check_motion(2.0)

    def test_time_that_goes_back(self):
        """It starts by itself again, in a map of its own that is level too."""
        self.start_node()
        self.feed(inertial_drive.drive(0.0, 5.0, START))
        self.answered(START + 4.9)
        self.feed(inertial_drive.drive(0.0, 5.0, START - 100.0)[1:])
        self.wait_for(lambda: START - 95.5 < self.odometry[-1].header.stamp.to_sec() < START)
        before = next(i for i, m in enumerate(self.odometry) if m.header.stamp.to_sec() < START)
        self.check_level(before)
        first, last = (self.odometry[i].pose.pose.position for i in (before, -1))
        self.assertLess(math.hypot(first.x, first.y), 0.1)
        x, y, _ = inertial_drive.pose_at(self.odometry[-1].header.stamp.to_sec() - START + 100.0)
        np.testing.assert_allclose((last.x, last.y), (x, y), atol=0.2)

    def test_accelerations_in_g_are_refused(self):
        """No pose; the log and the diagnostics say what is wrong, what is allowed, and what it may be."""
        self.start_node()
        messages = inertial_drive.drive(0.0, 4.0, START)
        for topic, message in messages:
            if topic == "imu":
                a = message.linear_acceleration
                a.x, a.y, a.z = (v / inertial_drive.GRAVITY for v in (a.x, a.y, a.z))
        self.feed(messages)
        status = self.report("estimator", lambda s: "gravity is not explained" in s.message)
        self.assertEqual(DiagnosticStatus.WARN, status.level)
        self.assertIn("not started: ", status.message)
        self.assertIn("it must be 9.81 within", status.message)
        self.assertIn("are they in g? they must be in m/s^2", self.report("inputs").message)
        self.assertFalse(self.odometry)
        told = PoseWithCovarianceStamped()
        told.header.frame_id = "map"
        told.pose.pose.orientation.w = 1.0
        answer = rospy.ServiceProxy("/%s/set_pose" % self.name, SetPose)(told)
        self.assertIn("not started: gravity is not explained", answer.message)
        told = [m.msg for m in self.said if m.msg.startswith("not started: gravity is not explained")]
        self.assertEqual(1, len(told), told)
        self.wait_for(lambda: any("no pose is published yet, not started: gravity is not explained" in m.msg
                                  for m in self.said if m.level == Log.WARN))

    def test_accelerations_without_gravity_are_refused(self):
        """As drivers give them that compensate for it."""
        self.start_node()
        messages = inertial_drive.drive(0.0, 4.0, START)
        for topic, message in messages:
            if topic == "imu":
                a, g = message.linear_acceleration, inertial_drive.to_imu((0.0, 0.0, inertial_drive.GRAVITY))
                a.x, a.y, a.z = a.x + 1e-3 - g[0], a.y - g[1], a.z - g[2]
        self.feed(messages)
        self.assertIn("gravity is missing", self.report("inputs", lambda s: "gravity" in s.message).message)
        self.assertIn("gravity is not explained", self.report("estimator").message)
        self.assertFalse(self.odometry)

    def test_accelerations_of_zero_are_none(self):
        """Of a gyro alone: then a velocity is needed, and asked for."""
        self.start_node()
        messages = inertial_drive.drive(0.0, 3.0, START)
        for topic, message in messages:
            if topic == "imu":
                a = message.linear_acceleration
                a.x = a.y = a.z = 0.0
        self.feed(messages)
        values = {value.key: value.value for value in self.report("estimator", lambda s: s.values[1].value).values}
        self.assertIn("constant twist, the IMU's messages carry no acceleration", values["motion"])
        self.assertIn("nothing yet on velocity", self.report("inputs").message)

    def test_an_imu_that_stops(self):
        """Is said to; frames go on to be answered, with less and less certainty where they see nothing."""
        self.start_node()
        messages = inertial_drive.drive(0.0, 9.0, START)
        for topic, message in messages:
            if topic == "features" and message.header.stamp.to_sec() > START + 3.05:
                message.features = []
        self.feed([m for m in messages if m[0] != "imu" or m[1].header.stamp.to_sec() < START + 3.0])
        self.answered(START + 6.0)
        status = self.report("inputs", lambda s: "the IMU has stopped" in s.message)
        self.assertEqual(DiagnosticStatus.WARN, status.level)
        variances = [min(self.odometry, key=lambda m: abs(m.header.stamp.to_sec() - START - t)).pose.covariance[0]
                     for t in (3.0, 4.5, 6.0)]
        self.assertGreater(variances[1], 4.0 * variances[0])
        self.assertGreater(variances[2], 4.0 * variances[1])
        self.assertEqual(1, len([m for m in self.said if "the IMU has stopped" in m.msg]))

    def test_odometry_at_the_rate_of_frames(self):
        """Where that is asked for."""
        self.start_node(ros={"odometry_rate": "frame"})
        messages = inertial_drive.drive(0.0, 4.0, START)
        self.feed(messages)
        self.wait_for(lambda: self.odometry and self.odometry[-1].header.stamp.to_sec() >= START + 3.85)
        answered = {m.header.stamp for m in self.odometry}
        self.assertGreater(len(answered), 10)
        self.assertLessEqual(answered, {m.header.stamp for topic, m in messages if topic == "features"})

    # A state that is given

    def request(self, seconds):
        """The true one at a time of the drive, said in the map in which pose_at is."""
        state = inertial_drive.state_at(seconds)
        request = SetState._request_class()
        request.header.stamp, request.header.frame_id = rospy.Time.from_sec(START + seconds), "map"
        p, q = request.pose.position, request.pose.orientation
        p.x, p.y, p.z = state["position"]
        q.x, q.y, q.z, q.w = state["orientation"]
        request.velocity.x, request.velocity.y, request.velocity.z = state["velocity"]
        request.covariance = state["covariance"]
        return request

    def check_pose(self):
        """The last odometry is the true pose itself."""
        last = self.odometry[-1]
        x, y, _ = inertial_drive.pose_at(last.header.stamp.to_sec() - START)
        np.testing.assert_allclose((last.pose.pose.position.x, last.pose.pose.position.y), (x, y), atol=0.15)

    def test_set_state(self):
        """Everything begins anew from there; what is no state is refused by name and changes nothing."""
        self.start_node()
        self.feed(inertial_drive.drive(MOVING, MOVING + 3.0, START))
        self.answered(START + MOVING + 2.9)
        service = "/%s/set_state" % self.name
        rospy.wait_for_service(service, timeout=20.0)
        set_state = rospy.ServiceProxy(service, SetState)
        now = MOVING + 3.0
        for part, spoil in (("'odom', allowed: the map's frame 'map'", lambda r: setattr(r.header, "frame_id", "odom")),
                            ("header.stamp is 0", lambda r: setattr(r.header, "stamp", rospy.Time())),
                            ("header.stamp is 99", lambda r: setattr(r.header, "stamp", rospy.Time.from_sec(START + now + 99.5))),
                            ("pose.orientation has the norm", lambda r: setattr(r.pose.orientation, "w", 7.0)),
                            ("velocity is of norm nan, allowed: finite", lambda r: setattr(r.velocity, "x", float("nan"))),
                            ("gyro_bias is of norm 11, allowed: finite, of a norm of at most 10",
                             lambda r: setattr(r.gyro_bias, "y", 11.0)),
                            ("covariance is not one, allowed: 225 numbers of a symmetric positive definite",
                             lambda r: setattr(r, "covariance", [0.0] * 225))):
            request = self.request(now)
            spoil(request)
            answer = set_state(request)
            self.assertFalse(answer.success)
            self.assertIn(part, answer.message)
        before = len(self.odometry)
        answer = set_state(self.request(now))
        self.assertTrue(answer.success, answer.message)
        self.feed(inertial_drive.drive(now, now + 3.0, START)[3:])
        self.answered(START + now + 2.9)
        self.assertGreater(len(self.odometry), before)
        self.check_pose()
        self.check_level(before)
        # Where the pose begins anew somewhere else dead reckoning goes on. Of a burst not every message may come.
        self.assertGreater(len(self.dead_reckoning), 50)
        for a, b in zip(self.dead_reckoning, self.dead_reckoning[1:]):
            p, q = a.pose.pose.position, b.pose.pose.position
            elapsed = (b.header.stamp - a.header.stamp).to_sec()
            self.assertLess(math.hypot(q.x - p.x, q.y - p.y), 0.1 + 1.2 * drive_data.SPEED * elapsed, elapsed)

    def test_initial_state(self):
        """Of a file: it is there with the first measurement, and a file that is none keeps the node from starting."""
        path = os.path.join(self.output, "state.yaml")
        state = {key: [float(v) for v in value] for key, value in inertial_drive.state_at(MOVING).items()}
        with open(path, "w") as file:
            yaml.safe_dump(dict(state, stamp="%.9f" % (START + MOVING)), file)
        self.start_node(initial_state=path)
        self.feed(inertial_drive.drive(MOVING, MOVING + 3.0, START))
        self.answered(START + MOVING + 2.9)
        self.assertLess(self.odometry[0].header.stamp.to_sec(), START + MOVING + 0.1)
        self.check_pose()
        self.check_level()
        with open(path, "w") as file:
            yaml.safe_dump(dict(state, stamp="%.9f" % START, velocity="fast"), file)
        self.assertIn("velocity", self.refused(initial_state=path))


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "inertial", InertialTest, sys.argv)
