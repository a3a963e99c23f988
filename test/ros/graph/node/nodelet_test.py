#!/usr/bin/env python3
"""The nodelet in a manager: it ends as the node does, and its faults are its own."""

import os
import signal
import subprocess
import sys

import rosservice
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from roslib.packages import find_node
from tf2_msgs.msg import TFMessage

from node_runner import START, NodeRunner, patiently

MANAGER = "slam_manager"


class NodeletTest(NodeRunner):
    """A manager of its own for each test."""

    name = "slam_in_manager"

    def setUp(self):
        super().setUp()
        self.reports = self.listen("/diagnostics", DiagnosticArray)

    def start_process(self, *arguments):
        """Its output comes to a file of its own."""
        log = os.path.join(self.output, "log_%d" % len(os.listdir(self.output)))
        with open(log, "w", encoding="utf-8") as file:
            process = subprocess.Popen(arguments, stdout=file, stderr=subprocess.STDOUT)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        process.log = log
        return process

    def start_nodelet(self, *remappings, **parameters):
        """(manager, what loaded the nodelet), once it listens."""
        self.set_parameters(patiently(parameters))
        self.wait_for(lambda: not any(p.get_num_connections() for p in self.publishers.values()))
        nodelet = find_node("nodelet", "nodelet")[0]
        manager = self.start_process(nodelet, "manager", "__name:=" + MANAGER)
        loader = self.start_process(nodelet, "load", "vi_ekf_slam/SlamNodelet", MANAGER, "__name:=" + self.name, *remappings)
        self.wait_for(lambda: all(p.get_num_connections() > 0 for p in self.publishers.values()))
        return manager, loader

    def log(self, process):
        """What it has said."""
        with open(process.log, encoding="utf-8", errors="replace") as file:
            return file.read()

    def statuses(self):
        """All diagnostics so far."""
        return [status for report in self.reports for status in report.status]

    def results(self):
        """Folder of the results."""
        return os.path.join(self.output, "results")

    def poses(self):
        """Stamps (s) of the saved trajectory."""
        with open(os.path.join(self.results(), "trajectory.tum"), encoding="ascii") as file:
            return [float(line.split()[0]) for line in file]

    def check_signal(self, number):
        """All that was published before it is saved, and it says so."""
        manager, _ = self.start_nodelet(output_dir=self.results(), autosave_period=0)
        self.play(0.0, 3.0)
        self.answered(START + 3.0)
        manager.send_signal(number)
        self.assertEqual(0, manager.wait(20))
        self.assertEqual(31, len(self.poses()))
        self.assertIn("saved 31 poses in " + self.results(), self.log(manager))

    def test_sigterm_saves_what_the_node_saves(self):
        """kill, system shutdown."""
        self.check_signal(signal.SIGTERM)

    def test_sighup_saves_what_the_node_saves(self):
        """The terminal is closed."""
        self.check_signal(signal.SIGHUP)

    def test_sigint_saves_what_the_node_saves(self):
        """Control-C, roslaunch."""
        self.check_signal(signal.SIGINT)

    def test_unloaded_it_leaves_a_manager_that_can_be_ended(self):
        """By its own handlers."""
        manager, loader = self.start_nodelet(output_dir=self.results(), autosave_period=0)
        self.play(0.0, 1.0)
        loader.send_signal(signal.SIGINT)
        loader.wait(20)
        self.wait_for(lambda: os.path.exists(os.path.join(self.results(), "trajectory.tum")))
        self.assertIsNone(manager.poll())
        manager.send_signal(signal.SIGINT)
        manager.wait(20)

    def test_its_diagnostics_bear_its_name(self):
        """Not its manager's, in which there may be several."""
        self.start_nodelet()
        self.wait_for(self.statuses)
        self.assertEqual({self.name}, {status.name.split(": ")[0] for status in self.statuses()})

    def test_its_transforms_go_where_they_are_remapped_to(self):
        """In a manager that knows nothing of it."""
        sent = self.listen("/robot/tf", TFMessage)
        self.start_nodelet("/tf:=/robot/tf")
        self.play(0.0, 1.0)
        self.wait_for(lambda: sent)
        published = dict(rospy.get_master().getSystemState()[2][0])
        self.assertNotIn("/" + MANAGER, published.get("/tf", []))

    def check_failure_is_reported(self):
        """In the nodelet's name."""
        failed = [s for s in self.statuses() if s.level == DiagnosticStatus.ERROR and "the computing has ended" in s.message]
        self.assertTrue(failed)
        self.assertEqual({self.name}, {s.name.split(": ")[0] for s in failed})

    def test_a_fault_ends_the_nodelet_and_nothing_else(self):
        """Said in log and diagnostics; what loaded it ends too, so that roslaunch can start it again."""
        manager, loader = self.start_nodelet(output_dir=self.results(), autosave_period=0, resume=True)
        self.fail_at_a_reset(manager, lambda: loader.poll() is not None)
        self.assertIn("the computing has ended", self.log(manager))
        self.assertIn("the nodelet ends", self.log(manager))
        self.check_failure_is_reported()
        self.assertIsNone(manager.poll())
        self.wait_for(lambda: "/%s/reset" % self.name not in rosservice.get_service_list())
        self.assertIn("/%s/load_nodelet" % MANAGER, rosservice.get_service_list())
        self.assertGreater(len(self.poses()), 255)  # what was computed until then

    def test_a_fault_ends_a_standalone_nodelet(self):
        """The process with it, as loudly."""
        self.set_parameters(patiently({"output_dir": self.results(), "autosave_period": 0, "resume": True}))
        self.wait_for(lambda: not any(p.get_num_connections() for p in self.publishers.values()))
        alone = self.start_process(find_node("nodelet", "nodelet")[0], "standalone", "vi_ekf_slam/SlamNodelet",
                                   "__name:=" + self.name)
        self.wait_for(lambda: all(p.get_num_connections() > 0 for p in self.publishers.values()))
        self.fail_at_a_reset(alone, lambda: alone.poll() is not None)
        self.assertIn("the computing has ended", self.log(alone))
        self.assertIn("the nodelet ends", self.log(alone))
        self.check_failure_is_reported()
        self.assertGreater(len(self.poses()), 255)


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "nodelet", NodeletTest, sys.argv)
