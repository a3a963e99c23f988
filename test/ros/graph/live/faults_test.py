#!/usr/bin/env python3
"""Faults of time and of content, with simulated time: what comes of each, and that /diagnostics counts it."""

import copy
import sys
import time

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticStatus

import drive_data
from drive_player import LENGTH, DrivePlayer
from waiting import wait_for
from vi_ekf_slam.msg import StereoFeature

NAN, INF = float("nan"), float("inf")
TOPICS = ("imu", "velocity", "features")


class Faults(DrivePlayer):
    """Each fault, in a drive of its own."""

    # Time

    def test_a_clean_drive_counts_nothing(self):
        """So that what the others count is theirs."""
        self.play(self.drive())
        self.assertTrue(self.answered(self.start + LENGTH))
        self.check_counts({})
        self.check_transforms()
        self.check_pose(LENGTH)

    def inject(self, faults, counts, elapsed=LENGTH):
        """Plays the drive with `faults` (topic, message) in its middle; the outcome is that of a clean drive."""
        messages = self.drive()
        middle = next(i for i, (topic, m) in enumerate(messages)
                      if topic == "imu" and m.header.stamp.to_sec() > self.start + 1.15)
        self.play(messages[:middle] + faults + messages[middle:])
        self.assertTrue(self.answered(self.start + LENGTH))
        self.check_counts(counts)
        self.check_transforms()
        self.check_pose(elapsed)

    def at(self, seconds):
        """Stamp `seconds` after the start."""
        return rospy.Time.from_sec(self.start + seconds)

    def test_late_stamps(self):
        """Older than what was answered, by less than a jump."""
        self.inject([("imu", drive_data.imu(self.at(0.35))), ("velocity", drive_data.velocity(self.at(0.35))),
                     ("features", drive_data.features(self.at(0.35), 0.35))],
                    {"imu: late": 1, "velocity: late": 1, "features: late": 1})

    def test_repeated_stamps(self):
        """Each message of the last step twice."""
        self.inject([(topic, m) for topic, m in self.drive() if topic in TOPICS and
                     abs(m.header.stamp.to_sec() - self.start - 1.1) < 0.01],
                    {"imu: duplicate": 1, "velocity: duplicate": 1, "features: duplicate": 1})

    def test_small_disorder_is_sorted(self):
        """Streams up to 0.1 s apart: nothing is lost."""
        self.play(sorted(self.drive(), key=lambda m: drive_data.stamp_of(m[1]).to_sec() +
                         {"features": 0.1, "velocity": 0.05}.get(m[0], 0.0)))
        self.assertTrue(self.answered(self.start + LENGTH))
        self.check_counts({})
        self.check_transforms()

    def test_future_and_ancient_stamps(self):
        """Single ones, by years, minutes and seconds."""
        self.inject([("imu", drive_data.imu(rospy.Time.from_sec(4e9))),
                     ("velocity", drive_data.velocity(self.at(90.0))),
                     ("features", drive_data.features(self.at(5.0), 5.0)),
                     ("imu", drive_data.imu(rospy.Time.from_sec(1.0)))],
                    {"imu: stamp far ahead of the others": 1, "velocity: stamp far ahead of the others": 1,
                     "features: stamp far ahead of the others": 1, "imu: stamp far behind the others": 1})

    def test_two_clocks(self):
        """A velocity whose clock began at its switch-on is dropped, the rest goes on."""
        messages = self.drive()
        for topic, message in messages:
            if topic == "velocity":
                message.header.stamp = rospy.Time.from_sec(message.header.stamp.to_sec() - self.start + 5.0)
        self.play(messages)
        self.assertTrue(self.answered(self.start + LENGTH))
        grown = self.counts()
        key = "velocity: stamp far behind the others"
        self.assertGreaterEqual(int(grown[key]) - int(self.before.get(key, 0)), 19)
        self.check_transforms()

    def test_a_gap_of_seconds_is_bridged(self):
        """Nothing is lost on either side, dead reckoning goes on."""
        messages = self.drive(duration=8.0 + LENGTH)
        before, after = ([m for m in messages if low < drive_data.stamp_of(m[1]).to_sec() - self.start < high]
                         for low, high in ((-INF, 2.05), (7.95, INF)))
        self.play(before)
        self.assertTrue(self.answered(self.start + 2.0))  # a topic that comes late would contradict the gap
        self.play(after)
        self.assertTrue(self.answered(self.start + 8.0 + LENGTH))
        self.check_counts({"gaps": 1})
        self.check_transforms()
        self.check_pose(8.0 + LENGTH, 1.5)

    def test_a_bag_that_loops(self):
        """Twice the same stamps; simulated time restarts with them. The second round begins anew and loses nothing."""
        once, known = self.drive(), len(self.reports)
        self.play(once)
        self.assertTrue(self.answered(self.start + LENGTH))
        self.play(copy.deepcopy(once))
        self.assertTrue(self.answered(self.start + LENGTH))
        self.assertTrue(wait_for(lambda: len(self.odometry) - self.heard[0] >= 42), len(self.odometry) - self.heard[0])
        self.check_counts({"resets": 1})
        self.check_transforms(restarts=1)
        self.check_pose(LENGTH)
        said = [(s.level, s.message) for r in self.reports[known:] for s in r.status if "anew: time jumped back" in s.message]
        self.assertEqual([DiagnosticStatus.WARN], [level for level, _ in said], said)

    # Content

    def test_numbers_that_are_none(self):
        """NaN, infinity, absurd speed, covariances that are none; the rest is used."""
        faults = []
        for value in (NAN, INF, -INF):
            message = drive_data.imu(self.at(1.12))
            message.angular_velocity.y = value
            faults.append(("imu", message))
        for covariance in ([-1e-6] * 1 + [0.0] * 8, [1e-6, 1e-3, 0, 0, 1e-6, 0, 0, 0, 1e-6],
                           [1e-6, 1e-6, 0, 1e-6, 1e-6, 0, 0, 0, 1e-6]):
            message = drive_data.imu(self.at(1.12))
            message.angular_velocity_covariance = covariance
            faults.append(("imu", message))
        fast = drive_data.velocity(self.at(1.12))
        fast.twist.twist.linear.x = 1e308
        nothing = drive_data.velocity(self.at(1.12))
        nothing.twist.covariance = [-1.0] + [0.0] * 35
        self.inject(faults + [("velocity", fast), ("velocity", nothing)],
                    {"imu: not finite": 3, "imu: covariance not positive definite": 3, "velocity: too fast": 1,
                     "velocity: covariance[0] = -1, no data": 1})

    def test_wrong_frames_and_zero_stamps(self):
        """Of each input."""
        stamp = self.at(1.12)
        faults = [("imu", drive_data.imu(stamp)), ("velocity", drive_data.velocity(stamp)),
                  ("features", drive_data.features(stamp, 1.12))]
        for _, message in faults:
            message.header.frame_id = "somewhere"
        self.inject(faults + [("imu", drive_data.imu(rospy.Time()))],
                    {"imu: wrong frame": 1, "velocity: no transform from its frame to the IMU's": 1, "features: wrong frame": 1,
                     "imu: stamp is zero": 1})

    def test_features_are_rejected_one_by_one(self):
        """A frame with bad features among good ones: the good ones are used."""
        frame = drive_data.features(self.at(1.15), 1.15)
        good = len(frame.features)
        frame.features += [StereoFeature(1000, NAN, 10, 5, 10, 0.0, 0.0, b""), StereoFeature(1001, 100, INF, 90, 100, 0.0, 0.0, b""),
                           StereoFeature(1002, 100, 100, 110, 100, 0.0, 0.0, b""), StereoFeature(1003, 100, 1e300, 90, 100, 0.0, 0.0, b""),
                           StereoFeature(1004, 600, 100, -100, 100, 0.0, 0.0, b""),
                           StereoFeature(frame.features[0].id, 100, 100, 90, 100, 0.0, 0.0, b"")]
        before = int(self.before.get("features without disparity", 0))
        self.inject([("features", frame)], {"features: pixel not finite": 2, "features: absurd pixel or disparity": 2,
                                            "features: repeated id": 1})
        self.assertEqual(before + 1, int(self.counts()["features without disparity"]))
        self.assertGreater(good, 5)

    def test_fifty_thousand_features_and_none(self):
        """A flood is cut to max_features, an empty message is a frame that sees nothing; the node goes on."""
        flood = drive_data.features(self.at(1.13), 1.13)
        flood.features = [StereoFeature(10000 + i, 20 + i % 600, 10 + i % 460, 10 + i % 600, 10 + i % 460, 0.0, 0.0, b"")
                          for i in range(50000)]
        empty = drive_data.features(self.at(1.16), 1.16)
        empty.features = []
        started = time.monotonic()
        self.inject([("features", flood), ("features", empty)],
                    {"features: more than max_features in a message": 49600})
        self.assertLess(time.monotonic() - started, 30.0)

    def test_camera_info_that_changes(self):
        """The first one stays; the change is reported."""
        info = drive_data.camera_info(self.at(1.12), False)
        info.P = [2 * p for p in info.P]
        self.inject([("left/camera_info", info)], {})
        self.assertEqual(DiagnosticStatus.WARN, self.counts()["calibration"])

    def test_a_blinded_car(self):
        """Without features it reckons on, and warns."""
        messages = self.drive()
        for topic, message in messages:
            if topic == "features" and message.header.stamp > self.at(0.55):
                message.features = []
        self.play(messages)
        self.assertTrue(self.answered(self.start + LENGTH))
        self.assertEqual(DiagnosticStatus.WARN, self.counts()["divergence"])


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "faults", Faults, sys.argv)
