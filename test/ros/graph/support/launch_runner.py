"""Runs slam.launch as a user does."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import unittest

import rospkg

import drive_data

PACKAGE = "vi_ekf_slam"
LIMIT = 60.0  # s
IMU_CALIBRATION = ("{gyroscope_noise_density: 1.0e-4, accelerometer_noise_density: 1.0e-3, "
                   "gyroscope_random_walk: 1.0e-5, accelerometer_random_walk: 1.0e-3}\n")


def free_port():
    """Of a master of one's own."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def processes_with(word):
    """[(id, command line)] of the processes that were started with it."""
    found = []
    for process in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open("/proc/%s/cmdline" % process, encoding="utf-8", errors="replace") as file:
                line = file.read().replace("\0", " ")
        except OSError:  # it has ended meanwhile
            continue
        if word in line:
            found.append((int(process), line))
    return found


class LaunchRunner(unittest.TestCase):
    """Each test has a folder of its own with a drive of 6 s in `bag`."""

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="vi_ekf_slam_launch_")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.bag = os.path.join(self.folder, "drive.bag")
        self.config = os.path.join(os.path.dirname(os.path.abspath(__file__)), "test_config.yaml")
        drive_data.write_bag(self.bag, drive_data.drive(gyro_per_frame=2))

    def config_with_a_file_beside_it(self):
        """Path of the test's configuration, with the name of an IMU's calibration that is in the same folder."""
        with open(self.config, encoding="ascii") as file:
            text = file.read() + "inertial: {imu_calibration: imu.yaml}\n"
        for name, content in (("mine.yaml", text), ("imu.yaml", IMU_CALIBRATION)):
            with open(os.path.join(self.folder, name), "w", encoding="ascii") as file:
                file.write(content)
        return os.path.join(self.folder, "mine.yaml")

    def start(self, *arguments, own_master=False):
        """roslaunch as a process; its output is piped."""
        environment, port = dict(os.environ, PWD=self.folder), []
        if own_master:
            port = ["-p", str(free_port())]
            environment["ROS_MASTER_URI"] = "http://localhost:" + port[1]
        launch_file = os.path.join(rospkg.RosPack().get_path(PACKAGE), "launch", "slam.launch")
        process = subprocess.Popen(["roslaunch"] + port + [launch_file] + list(arguments), env=environment, cwd=self.folder,
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.addCleanup(self.stop, process)
        return process

    def stop(self, process):
        """As Control-C does. Returns what it has said."""
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        return self.finish(process)

    def read_until(self, process, word):
        """What it says up to the line with this word."""
        said = ""
        while word not in said:
            line = process.stdout.readline().decode(errors="replace")
            if not line:
                self.fail("roslaunch ends without %r: %s" % (word, said))
            said += line
        return said

    def finish(self, process):
        """Waits for its end. Returns what it has said."""
        if process.stdout.closed:
            return ""
        try:
            return process.communicate(timeout=LIMIT)[0].decode(errors="replace")
        except subprocess.TimeoutExpired:
            left = processes_with(self.folder)
            process.kill()
            for pid, _ in left:  # they would hold the pipe open
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            try:
                said = process.communicate(timeout=10.0)[0].decode(errors="replace")
            except subprocess.TimeoutExpired:
                said = "(another process holds its output open)"
            self.fail("roslaunch does not end, these run: %s; %s" % (left, said))

    def launch(self, *arguments):
        """Plays the bag with a master of its own; returns (status, what was said)."""
        process = self.start(*arguments, own_master=True)
        said = self.finish(process)
        return process.returncode, said

    def play(self, *arguments):
        """The same, with the test's configuration and faster; fails unless it ends as a success. Returns what was said."""
        status, said = self.launch("bag:=" + self.bag, "config:=" + self.config, "rate:=4", *arguments)
        self.assertEqual(0, status, said)
        self.assertNotIn("REQUIRED", said)
        self.assertNotIn("has died", said)
        return said
