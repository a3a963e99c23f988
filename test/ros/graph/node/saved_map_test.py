#!/usr/bin/env python3
"""A node goes on where a killed one was saved, or finds its place in a map that was loaded."""

import functools
import math
import os
import sys

import numpy as np
import rosbag
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Path
from std_srvs.srv import Trigger

import drive_data
from node_runner import START, WITHOUT_SLIP, NodeRunner, bound_files
from vi_ekf_slam.srv import LoadMap, SaveMap
from waiting import wait_for

ALONE = "begun anew, no map loaded"
WAITING = "not yet relocalised in the earlier map"
RELOCALISED = "relocalised in the earlier map"
RESUMED = "resumed from the saved map"


class Format1:
    """MapState as it was, with what rosbag needs to write its bytes."""

    _type, _md5sum, _full_text = "vi_ekf_slam/MapState", "b8c6e3bae06010c0888cce2f96b7df60", "float64[6] twist"


class SavedMap(NodeRunner):
    """A node of its own for each test, or two after each other."""

    name = "slam_saved_map"

    def setUp(self):
        super().setUp()
        self.paths = self.listen("path", Path)
        self.reports = self.listen("/diagnostics", DiagnosticArray)

    def start_node(self, preexec_fn=None, **parameters):
        """Told that the tracks of this drive do not slip."""
        parameters.setdefault("invariant", WITHOUT_SLIP)
        return super().start_node(preexec_fn, **parameters)

    def wait_for_report(self, level, text):
        """Until the diagnostics say this of the map, from now on."""
        del self.reports[:]
        said = []

        def is_said():
            said[:] = [(s.level, s.message) for r in self.reports for s in r.status if s.name == self.name + ": map"]
            return (level, text) in said
        self.assertTrue(wait_for(is_said, 10.0), said)

    def call(self, service, *arguments):
        """Calls a private service."""
        name = "/%s/%s" % (self.name, service)
        rospy.wait_for_service(name, timeout=20.0)
        return rospy.ServiceProxy(name, {"save_map": SaveMap, "load_map": LoadMap}.get(service, Trigger))(*arguments)

    def errors(self, messages, start=START):
        """Distances (m) from the circle that is driven, in the frame in which it began."""
        poses = [(m.header.stamp.to_sec() - start, getattr(m.pose, "pose", m.pose)) for m in messages]
        positions = [(t, pose.position) for t, pose in poses]
        return [math.hypot(p.x - drive_data.pose_at(t)[0], p.y - drive_data.pose_at(t)[1]) for t, p in positions]

    def stamps(self, *name):
        """Of a saved trajectory (s); none without it."""
        path = os.path.join(self.output, *name)
        if not os.path.exists(path):
            return []
        with open(path, encoding="ascii") as file:
            return [float(line.split()[0]) for line in file]

    def saved_at(self, name):
        """When a file was written last (ns); 0 without it."""
        path = os.path.join(self.output, name)
        return os.stat(path).st_mtime_ns if os.path.exists(path) else 0

    def save_first_drive(self, change=None):
        """A node that has driven 8 s and saved its map, in output/first."""
        first = os.path.join(self.output, "first")
        node = self.start_node(output_dir=first, autosave_period=0)
        self.play(0.0, 8.0, change=change)
        self.answered(START + 7.7)
        self.wait_for_report(DiagnosticStatus.OK, ALONE)
        answer = self.call("save_map")
        self.assertTrue(answer.success, answer.message)
        node.terminate()
        self.assertEqual(0, node.wait(20))
        path = os.path.join(first, "map.bag")
        self.assertTrue(os.path.exists(path))
        self.assertTrue(os.path.exists(os.path.join(first, "landmarks.csv")))
        del self.odometry[:]
        return path

    def test_a_killed_node_goes_on_from_its_last_autosave(self):
        """In the same frame, from the first pose on, and without a copy of what was computed before."""
        parameters = {"output_dir": self.output, "autosave_period": 0.5, "resume": True, "diagnostic_period": 0.1}
        node = self.start_node(**parameters)
        self.play(0.0, 6.0)
        for service in ("save_map", "save_trajectory"):  # beside the autosaves
            answer = self.call(service)
            self.assertTrue(answer.success, answer.message)
        self.answered(START + 5.7)
        self.wait_for(lambda: self.stamps("trajectory.tum") and self.stamps("trajectory.tum")[-1] >= START + 5.7)
        saved = self.saved_at("trajectory.tum")  # whose map comes after it
        self.wait_for(lambda: self.saved_at("map.bag") > saved)
        self.play(6.1, 6.3)  # lost
        node.kill()
        node.wait(20)
        self.assertLess(max(self.errors(self.odometry)), 0.5)
        del self.odometry[:]

        node = self.start_node(**parameters)
        self.play(6.6, 10.0)
        self.answered(START + 9.7)
        self.wait_for_report(DiagnosticStatus.OK, RESUMED)
        node.terminate()
        self.assertEqual(0, node.wait(20))
        errors = self.errors(self.odometry)
        self.assertGreater(len(errors), 25)
        self.assertLess(max(errors), 0.5, errors)
        saved = self.stamps("trajectory.tum")
        self.assertGreaterEqual(saved[0], START + 6.5)
        self.assertGreaterEqual(saved[-1], START + 9.7)
        before = self.stamps("before_resume_1", "trajectory.tum")
        self.assertEqual(START, before[0])
        self.assertGreaterEqual(before[-1], START + 5.7)
        print("resumed: errors of %.3f m at first, %.3f m at most" % (errors[0], max(errors)))

    def test_a_node_that_is_respawned_too_late_finds_its_place(self):
        """After a gap that is longer than any that is bridged."""
        path = self.save_first_drive()
        start = START + 500.0
        node = self.start_node(output_dir=os.path.dirname(path), autosave_period=0, resume=True)
        self.play(6.0, 9.0, start)
        self.answered(start + 8.7)
        self.assertGreater(self.errors(self.odometry[:1], start)[0], 5.0)  # a frame of its own
        self.assertLess(self.errors(self.odometry, start)[-1], 0.5)
        node.kill()
        node.wait(20)

    def test_a_map_is_loaded_at_the_start_and_by_request(self):
        """Poses before the place is found are kept apart; a file that is none changes nothing."""
        path = self.save_first_drive()
        start = START + 500.0
        second = os.path.join(self.output, "second")
        node = self.start_node(output_dir=second, autosave_period=0, map_file=path)
        self.wait_for_report(DiagnosticStatus.WARN, WAITING)
        self.play(6.0, 8.0, start)
        self.answered(start + 7.7)
        self.wait_for_report(DiagnosticStatus.OK, RELOCALISED)
        self.assertGreater(self.errors(self.odometry[:1], start)[0], 5.0)
        self.assertLess(self.errors(self.odometry, start)[-1], 0.5)
        self.wait_for(lambda: self.paths and self.errors(self.paths[-1].poses[:1], start)[0] < 0.5)  # begun anew

        with open(path, "rb") as file:
            content = file.read()
        with open(path, "wb") as file:
            file.write(content[:len(content) // 2])
        answer = self.call("load_map")
        self.assertFalse(answer.success)
        self.assertIn(path, answer.message)
        heard = len(self.odometry)
        self.play(8.1, 9.0, start)
        self.answered(start + 8.7)
        self.assertLess(max(self.errors(self.odometry[heard:], start)), 0.5)  # as if nothing had been asked

        with open(path, "wb") as file:
            file.write(content)
        answer = self.call("load_map")
        self.assertTrue(answer.success, answer.message)
        self.wait_for_report(DiagnosticStatus.WARN, WAITING)
        self.play(9.1, 11.0, start)
        self.answered(start + 10.7)
        self.assertLess(self.errors(self.odometry, start)[-1], 0.5)
        node.terminate()
        self.assertEqual(0, node.wait(20))
        self.assertFalse(os.path.exists(os.path.join(second, "map.bag")))  # nobody asked
        self.assertTrue(self.stamps("second", "before_reset_1", "trajectory.tum"))
        self.assertGreater(self.stamps("second", "trajectory.tum")[0], start + 9.0)

    def landmarks(self, *name):
        """Number of those in a saved map."""
        with rosbag.Bag(os.path.join(self.output, *name)) as bag:
            return bag.get_message_count("landmarks")

    def test_a_reset_looks_for_the_map_of_before_where_it_resumes(self):
        """And keeps it on the disk too, where the new one takes its place."""
        self.start_node(output_dir=self.output, autosave_period=0.5, resume=True)
        self.play(0.0, 8.0)
        self.answered(START + 7.7)
        self.wait_for_report(DiagnosticStatus.OK, ALONE)
        start = START + 500.0
        self.play(6.0, 6.2, start)  # too few frames to be found by them
        self.answered(start + 6.1)
        self.wait_for_report(DiagnosticStatus.WARN, WAITING)
        self.wait_for(lambda: os.path.exists(os.path.join(self.output, "before_reset_1", "map.bag")))
        self.assertGreater(self.landmarks("before_reset_1", "map.bag"), 30)
        self.play(6.3, 9.0, start)
        self.answered(start + 8.7)
        self.wait_for_report(DiagnosticStatus.OK, RELOCALISED)
        self.assertLess(self.errors(self.odometry, start)[-1], 0.5)

    def test_a_reset_keeps_the_map_that_was_asked_for(self):
        """Beside the poses of before; it is not looked for, and the next one is saved at the end."""
        node = self.start_node(output_dir=self.output, autosave_period=0)
        self.play(0.0, 6.0)
        self.answered(START + 5.7)
        answer = self.call("save_map")
        self.assertTrue(answer.success, answer.message)
        saved = self.landmarks("map.bag")
        self.play(0.0, 1.0, START - 500.0)
        self.wait_for(lambda: self.odometry[-1].header.stamp.to_sec() < START)
        self.wait_for_report(DiagnosticStatus.OK, ALONE)
        node.terminate()
        self.assertEqual(0, node.wait(20))
        self.assertGreaterEqual(self.landmarks("before_reset_1", "map.bag"), saved)
        self.assertLess(self.landmarks("map.bag"), saved)

    def test_a_second_session_finds_its_place_by_looks_alone(self):
        """Its tracks have ids that say nothing; features look like the landmarks of the map."""
        def look(message):
            for feature in message.features:
                feature.descriptor = np.random.default_rng(feature.id).bytes(32)

        def look_and_renumber(message):
            look(message)
            for feature in message.features:
                feature.id += 100000
        path = self.save_first_drive(look)
        start = START + 500.0
        node = self.start_node(autosave_period=0, map_file=path)
        self.wait_for_report(DiagnosticStatus.WARN, WAITING)
        self.play(1.0, 7.5, start, look_and_renumber)
        self.answered(start + 7.2)
        self.wait_for_report(DiagnosticStatus.OK, RELOCALISED)
        self.assertGreater(self.errors(self.odometry[:1], start)[0], 1.0)  # a frame of its own
        self.assertLess(self.errors(self.odometry, start)[-1], 0.5)
        node.terminate()
        self.assertEqual(0, node.wait(20))

    def test_a_map_is_saved_to_a_file_and_loaded_from_it(self):
        """By name, without any output_dir; a name that cannot be followed is refused."""
        path = os.path.join(self.output, "hall.bag")
        node = self.start_node()
        self.assertFalse(self.call("save_map", "hall.bag").success)
        self.assertIn("absolute", self.call("load_map", "hall.bag").message)
        self.assertIn("output_dir", self.call("save_map").message)
        answer = self.call("save_map", path)
        self.assertFalse(answer.success, "nothing has been measured yet")
        self.assertIn(path, answer.message)
        self.play(0.0, 6.0)
        self.answered(START + 5.7)
        answer = self.call("save_map", path)
        self.assertTrue(answer.success, answer.message)
        self.assertIn(path, answer.message)
        self.assertEqual(["hall.bag"], os.listdir(self.output))
        self.assertFalse(self.call("load_map", path + "x").success)
        answer = self.call("load_map", path)
        self.assertTrue(answer.success, answer.message)
        self.wait_for_report(DiagnosticStatus.WARN, WAITING)
        self.assertFalse(self.call("save_map", path).success)  # it would replace what it waits to find
        self.play(6.1, 8.5)
        self.answered(START + 8.2)
        self.wait_for_report(DiagnosticStatus.OK, RELOCALISED)
        self.assertLess(self.errors(self.odometry)[-1], 0.5)
        node.terminate()
        node.wait(20)

    def test_a_map_that_the_disk_has_no_room_for_ends_no_node(self):
        """The request says why, nothing half written stays, and the estimate goes on."""
        path = os.path.join(self.output, "hall.bag")
        node = self.start_node(functools.partial(bound_files, 20000))  # bytes; the map of 3 s has more than 50000
        self.play(0.0, 3.0)
        self.answered(START + 2.7)
        for _ in range(2):
            answer = self.call("save_map", path)
            self.assertFalse(answer.success)
            self.assertIn(path + ": cannot be written", answer.message)
            self.assertEqual([], os.listdir(self.output))
        self.play(3.1, 5.0)
        self.answered(START + 4.7)
        node.terminate()
        self.assertEqual(0, node.wait(20))

    def test_what_cannot_be_started_with_is_refused(self):
        """Named with what is allowed."""
        path = os.path.join(self.output, "map.bag")
        self.assertIn(path + ": no such file", self.refused(map_file=path))
        with open(path, "w", encoding="ascii") as file:
            file.write("none")
        self.assertIn(path, self.refused(map_file=path))
        with rosbag.Bag(path, "w") as bag:
            bag.write("map", (Format1._type, bytes(1540), Format1._md5sum, Format1), raw=True)
        self.assertIn(path + ": written by an older version (format 1), allowed: format 2; save it anew",
                      self.refused(map_file=path))
        self.assertIn("map_file", self.refused(map_file=3))
        self.assertIn("resume", self.refused(output_dir=self.output, resume="perhaps"))
        self.assertIn("output_dir", self.refused(resume=True))

    def test_an_estimator_without_a_joint_map_says_so(self):
        """Its landmarks are saved all the same."""
        self.start_node(output_dir=self.output, autosave_period=0, estimator="paper")
        self.play(0.0, 1.0)
        self.answered(START + 0.7)
        answer = self.call("save_map")
        self.assertFalse(answer.success)
        self.assertIn("map.bag", answer.message)
        self.assertIn("landmarks.csv", answer.message)
        self.assertFalse(os.path.exists(os.path.join(self.output, "map.bag")))
        self.assertTrue(os.path.exists(os.path.join(self.output, "landmarks.csv")))
        self.assertFalse(self.call("load_map").success)


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "saved_map", SavedMap, sys.argv)
