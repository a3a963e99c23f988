#!/usr/bin/env python3
"""How slam.launch ends: with a status, with nothing half made, and with nothing that runs on."""

import os
import signal
import subprocess
import sys

import rostest

import drive_data
from launch_runner import LIMIT, PACKAGE, LaunchRunner, processes_with
from waiting import wait_for


class Ends(LaunchRunner):
    """Each with a master of its own."""

    def check_refused(self, word, *arguments):
        """Nothing is started, nothing is left, and what is wrong is said."""
        before = sorted(os.listdir(self.folder))
        status, said = self.launch(*arguments)
        self.assertEqual(1, status, said)
        self.assertIn(word, said)
        self.assertNotIn("started with pid", said)
        self.assertEqual(before, sorted(os.listdir(self.folder)))
        self.assertEqual([], processes_with(self.folder))

    def test_a_bag_that_is_missing_or_none(self):
        """Named with what is wrong."""
        self.check_refused("none.bag: no such file", "bag:=none.bag", "record:=true")
        with open(os.path.join(self.folder, "text.bag"), "w", encoding="ascii") as file:
            file.write("no bag\n")
        self.check_refused("text.bag: is not a bag", "bag:=text.bag")

    def test_a_configuration_with_an_error(self):
        """With a bag, and live."""
        bad = os.path.join(self.folder, "bad.yaml")
        with open(bad, "w", encoding="ascii") as file:
            file.write("invariant: {gate: -1}\n")
        self.check_refused("invariant.gate", "bag:=drive.bag", "config:=" + bad, "record:=true")
        self.check_refused("invariant.gate", "config:=" + bad, "output_dir:=run")

    def test_a_map_that_is_missing(self):
        """With a bag, and live."""
        self.check_refused("none.bag", "bag:=drive.bag", "map_file:=none.bag")
        self.check_refused("none.bag", "map_file:=none.bag", "output_dir:=run")

    def test_a_folder_that_cannot_be_made(self):
        """With a bag, and live. The look at one that can be made leaves none."""
        self.check_refused("/proc/none: cannot be created", "bag:=drive.bag", "output_dir:=/proc/none", "record:=true")
        self.check_refused("drive.bag/run: cannot be created", "output_dir:=drive.bag/run")
        subprocess.run([drive_data.program("run_bag"), "--check", "--output", os.path.join(self.folder, "new", "run")],
                       check=True, timeout=LIMIT)
        self.assertEqual(["drive.bag"], os.listdir(self.folder))

    def test_an_initial_state_that_is_none(self):
        """With a bag, and live; nor is one of use to another motion model."""
        self.check_refused("none.yaml", "bag:=drive.bag", "initial_state:=none.yaml")
        state = os.path.join(self.folder, "state.yaml")
        with open(state, "w", encoding="ascii") as file:
            file.write("stamp: 1.0\n")
        self.check_refused("position", "initial_state:=state.yaml", "output_dir:=run")
        with open(state, "w", encoding="ascii") as file:
            file.write("{stamp: 1.0, position: 0, orientation: [0, 0, 0, 1], velocity: 0, gyro_bias: 0, accelerometer_bias: 0, "
                       "covariance: [%s]}\n" % ", ".join("1" if i % 16 == 0 else "0" for i in range(225)))
        self.check_refused("motion", "initial_state:=state.yaml", "config:=" + self.config)

    def test_a_node_that_cannot_start_leaves_no_player(self):
        """The player waits for its listeners then, and hears no signal."""
        status, said = self.launch("bag:=drive.bag", "config:=" + self.config, "autosave_period:=-1", "record:=true",
                                   "record_path:=outputs.bag")
        self.assertIn("autosave_period must be", said)
        self.assertIn("REQUIRED process [slam", said)
        self.assertEqual([], processes_with(self.folder))
        self.assertEqual(["drive.bag"], os.listdir(self.folder))
        self.assertEqual(0, status)  # roslaunch's own, whatever its nodes end with

    def child(self, process, word):
        """Waits for a node of the launch, started with this word; its process id."""
        pids = []

        def runs():
            pids[:] = [pid for pid, _ in processes_with(word) if self.is_child(pid, process.pid)]
            return pids
        self.assertTrue(wait_for(runs), word)
        return pids[0]

    def node(self, process):
        """Waits until the node of the launch ends by itself when it is told to, and is not killed; its process id."""
        pid = self.child(process, "slam_node")
        self.assertTrue(wait_for(lambda: self.catches(pid, signal.SIGTERM)))
        return pid

    def wait_for_player(self):
        """Until the bag is played."""
        self.assertTrue(wait_for(lambda: any("rosbag/play" in line for _, line in processes_with(self.bag))))

    def test_live_nothing_ends_with_the_node(self):
        """What else was launched runs on."""
        process = self.start("config:=" + self.config, "record:=true", own_master=True)
        recorder = self.child(process, "record_outputs.py")
        node = self.node(process)
        os.kill(node, signal.SIGTERM)
        said = self.read_until(process, "process has finished cleanly")
        self.assertEqual(recorder, self.child(process, "record_outputs.py"))
        said += self.stop(process)
        self.assertNotIn("REQUIRED", said)
        self.assertRegex(said, r"\[record_outputs-\d+\] killing on exit")

    def test_with_a_bag_all_ends_with_the_node(self):
        """And says which of them was required."""
        process = self.start("bag:=" + self.bag, "config:=" + self.config, "rate:=0.1", own_master=True)
        node = self.node(process)
        self.wait_for_player()
        os.kill(node, signal.SIGTERM)
        said = self.finish(process)
        self.assertIn("REQUIRED process [slam-", said)
        self.assertTrue(wait_for(lambda: not processes_with(self.folder)), processes_with(self.folder))

    def test_a_killed_launch_leaves_no_player(self):
        """Not even kill -9 of the node that started it."""
        process = self.start("bag:=" + self.bag, "config:=" + self.config, "rate:=0.1", own_master=True)
        self.wait_for_player()
        os.kill(self.child(process, "play_bag.py"), 9)
        said = self.finish(process)
        self.assertIn("REQUIRED process [play_bag", said)
        self.assertTrue(wait_for(lambda: not processes_with(self.folder)), processes_with(self.folder))

    @staticmethod
    def catches(pid, number):
        """Whether the process has a handler for this signal."""
        with open("/proc/%d/status" % pid, encoding="ascii", errors="replace") as file:
            caught = next(line for line in file if line.startswith("SigCgt:"))
        return bool(int(caught.split()[1], 16) >> (number - 1) & 1)

    @staticmethod
    def is_child(pid, parent):
        """Whether the process is one of `parent`; one that has ended meanwhile is not."""
        try:
            with open("/proc/%d/stat" % pid, encoding="ascii", errors="replace") as file:
                return int(file.read().rsplit(")", 1)[1].split()[1]) == parent
        except OSError:
            return False


if __name__ == "__main__":
    rostest.rosrun(PACKAGE, "ends", Ends, sys.argv)
