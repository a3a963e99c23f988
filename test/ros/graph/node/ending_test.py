#!/usr/bin/env python3
"""Whatever ends the node, what it has computed is on the disk: all of it, or all but the last autosave_period."""

import os
import signal
import sys

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rosgraph_msgs.msg import Log
from std_srvs.srv import Trigger

from node_runner import START, NodeRunner, bound_files
from vi_ekf_slam.srv import SaveMap


def ignore_hangup():
    """As nohup does."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)


class Ending(NodeRunner):
    """A node of its own for each signal."""

    name = "slam_ending"

    def start(self, autosave_period):
        """The node, saving that often (s)."""
        return self.start_node(output_dir=self.output, autosave_period=autosave_period, diagnostic_period=0.1)

    def poses(self):
        """Lines of the saved trajectory; none without a file."""
        path = os.path.join(self.output, "trajectory.tum")
        if not os.path.exists(path):
            return 0
        with open(path, encoding="ascii") as file:
            lines = file.read()
        self.assertTrue(lines.endswith("\n"), "half a file")
        self.assertTrue(all(len(line.split()) == 8 for line in lines.splitlines()))
        return len(lines.splitlines())

    def play_and_hear(self):
        """Plays 3 s; all of it is answered then."""
        self.play(0.0, 3.0)
        self.answered(START + 3.0)

    def check_signal(self, number):
        """All that was published before the signal is saved, whole files only."""
        node = self.start(0)
        self.play_and_hear()
        self.assertEqual(0, self.poses())
        node.send_signal(number)
        self.assertEqual(0, node.wait(20))
        self.assertEqual(31, self.poses())
        names = sorted(os.listdir(self.output))
        self.assertEqual(["covariance.csv", "covariance_smoothed.csv", "dead_reckoning.tum", "frames.csv", "landmarks.csv",
                          "summary.yaml", "trajectory.tum", "trajectory_smoothed.tum"], names)

    def test_sigint(self):
        """Control-C, roslaunch."""
        self.check_signal(signal.SIGINT)

    def test_sigterm(self):
        """kill, system shutdown."""
        self.check_signal(signal.SIGTERM)

    def test_sighup(self):
        """The terminal is closed."""
        self.check_signal(signal.SIGHUP)

    def test_started_by_nohup_it_outlives_the_terminal(self):
        """And ends as it does otherwise."""
        node = self.start_node(ignore_hangup, output_dir=self.output, autosave_period=0)
        node.send_signal(signal.SIGHUP)
        self.play_and_hear()
        self.assertIsNone(node.poll())
        node.send_signal(signal.SIGTERM)
        self.assertEqual(0, node.wait(20))
        self.assertEqual(31, self.poses())

    def test_sigkill_loses_the_last_period_only(self):
        """What was computed a period before is there, and whole."""
        node = self.start(0.5)
        self.play_and_hear()
        self.wait_for(lambda: self.poses() >= 30 and os.path.exists(os.path.join(self.output, "summary.yaml")))
        self.play(3.1, 3.5)
        node.kill()
        node.wait(20)
        self.assertGreaterEqual(self.poses(), 30)
        self.assertTrue(os.path.exists(os.path.join(self.output, "summary.yaml")))

    def test_a_fault_ends_the_node(self):
        """With an exit code that says so; what was computed until then is there."""
        node = self.start_node(output_dir=self.output, autosave_period=0, resume=True)
        self.fail_at_a_reset(node, lambda: node.poll() is not None)
        self.assertEqual(1, node.wait(20))
        self.assertGreater(self.poses(), 255)

    def test_a_full_disk_does_not_end_the_node(self):
        """Its estimate goes on; that poses are missing is said at once, and by the exit code."""
        reports = self.listen("/diagnostics", DiagnosticArray)
        node = self.start_node(bound_files, output_dir=self.output, autosave_period=0, diagnostic_period=0.1)
        self.reckon_until(lambda: self.odometry and self.odometry[-1].header.stamp.to_sec() >= START + 89.0)
        self.wait_for(lambda: any(status.name.endswith(": results") and status.level == DiagnosticStatus.ERROR
                                  and "not all poses are saved" in status.message
                                  for report in list(reports) for status in report.status))
        self.assertIsNone(node.poll())
        node.send_signal(signal.SIGINT)
        self.assertEqual(1, node.wait(20))
        self.assertGreater(self.poses(), 255)

    def test_without_a_message_nothing_is_saved_or_replaced(self):
        """Neither a folder that was not there, nor over what an earlier run has left."""
        with open(os.path.join(self.output, "trajectory.tum"), "w", encoding="ascii") as file:
            file.write("of an earlier run")
        for folder in (self.output, os.path.join(self.output, "new", "run")):
            reports = self.listen("/diagnostics", DiagnosticArray)
            node = self.start_node(output_dir=folder, autosave_period=0.1, diagnostic_period=0.1)
            self.wait_for(lambda: len(reports) > 4)  # by the last it has looked at least twice whether a save is due
            for name, kind in (("save_trajectory", Trigger), ("save_map", SaveMap)):
                answer = rospy.ServiceProxy("/%s/%s" % (self.name, name), kind)()
                self.assertFalse(answer.success)
                self.assertIn("no measurement", answer.message)
            node.send_signal(signal.SIGINT)
            self.assertEqual(0, node.wait(20))
        self.assertEqual(["trajectory.tum"], os.listdir(self.output))
        with open(os.path.join(self.output, "trajectory.tum"), encoding="ascii") as file:
            self.assertEqual("of an earlier run", file.read())

    def test_a_missing_map_leaves_no_folder(self):
        """Nor does resuming move anything before the map is read."""
        for resume in (False, True):
            new = os.path.join(self.output, "new")
            self.assertIn("none.bag", self.refused(output_dir=new, resume=resume, map_file="/none.bag"))
            self.assertEqual([], os.listdir(self.output))

    def test_a_folder_that_went_away_is_a_failure(self):
        """Where the results cannot be saved the status says so."""
        folder = os.path.join(self.output, "run")
        node = self.start_node(output_dir=folder, autosave_period=0)
        self.play_and_hear()
        with open(folder, "w", encoding="ascii") as file:
            file.write("in the way")
        node.send_signal(signal.SIGINT)
        self.assertEqual(1, node.wait(20))

    def test_an_autosave_that_fails_is_in_the_diagnostics(self):
        """Where a robot is watched."""
        folder = os.path.join(self.output, "run")
        reports = self.listen("/diagnostics", DiagnosticArray)
        self.start_node(output_dir=folder, autosave_period=0.1, diagnostic_period=0.1)
        with open(folder, "w", encoding="ascii") as file:
            file.write("in the way")
        self.play_and_hear()
        self.wait_for(lambda: any(status.name.endswith(": results") and status.level == DiagnosticStatus.ERROR
                                  and "not saved" in status.message for report in list(reports) for status in report.status))

    def test_a_period_that_is_none_is_refused(self):
        """Named with what is allowed."""
        for value in (-1.0, float("nan"), "often", True):
            for name in ("autosave_period", "diagnostic_period"):
                self.assertIn(name + " must be a number of seconds", self.refused(output_dir=self.output, **{name: value}))

    def test_a_long_period_of_diagnostics_delays_nothing_else(self):
        """Neither what is saved nor what is warned of."""
        said = self.listen("/rosout", Log)
        self.start_node(output_dir=self.output, autosave_period=0.1, diagnostic_period=1000.0)
        self.wait_for(lambda: any("no message yet on" in m.msg for m in list(said)))
        self.play(0.0, 1.0)
        path = os.path.join(self.output, "trajectory.tum")
        self.wait_for(lambda: os.path.exists(path) and os.path.getsize(path) > 0)  # of the first save it may be empty
        self.wait_for(lambda: self.poses() >= 8)


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "ending", Ending, sys.argv)
