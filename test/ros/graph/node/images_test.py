#!/usr/bin/env python3
"""The front end in the graph: node, nodelet and run_bag make the same features, and what cameras do wrong is survived."""

import functools
import os
import subprocess
import sys
import time

import rosbag
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image

import drive_data
import image_data
from launch_runner import LIMIT, LaunchRunner
from node_runner import bound_files
from waiting import wait_for

from vi_ekf_slam.msg import StereoFeatureArray

SAME_FILES = ("trajectory.tum", "trajectory_smoothed.tum", "dead_reckoning.tum", "covariance.csv",
              "covariance_smoothed.csv", "landmarks.csv")
DURATION = 2.0  # s
FRAMES = 21
NODE = "front_end"


def read(*path):
    """Text of a file."""
    with open(os.path.join(*path), encoding="ascii") as file:
        return file.read()


def contents(feature):
    """All that it holds; a bag's messages are of another class."""
    return (feature.id, feature.u_left, feature.v_left, feature.u_right, feature.v_right, feature.sigma,
            feature.walk, bytes(feature.descriptor))


class Images(LaunchRunner):
    """Each test has a folder of its own with a bag of images."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node("images_test")
        cls.drive = image_data.drive(DURATION)
        cls.publishers = {topic: rospy.Publisher(topic, type(message), queue_size=10000, latch=topic == "/tf_static")
                          for topic, message in cls.drive}

    def setUp(self):
        super().setUp()
        drive_data.write_bag(self.bag, self.drive)
        self.features, self.reports = [], []
        for topic, kind, heard in (("features", StereoFeatureArray, self.features),
                                   ("/diagnostics", DiagnosticArray, self.reports)):
            listener = rospy.Subscriber(topic, kind, heard.append, queue_size=10000)
            self.addCleanup(listener.unregister)

    def run_bag(self):
        """(folder of run_bag's results, features that it saved)."""
        output, saved = os.path.join(self.folder, "run_bag"), os.path.join(self.folder, "features.bag")
        done = subprocess.run([drive_data.program("run_bag"), self.bag, "--output", output, "--config", self.config,
                               "--save-features", saved], check=False, timeout=LIMIT, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT)
        self.assertEqual(0, done.returncode, done.stdout.decode())
        with rosbag.Bag(saved) as bag:
            return output, [message for _, message, _ in bag.read_messages(["/features"])]

    def test_run_bag_on_a_full_disk(self):
        """Features, and the map: it ends with the status of what cannot be written, and leaves nothing half written."""
        output, saved = os.path.join(self.folder, "run"), os.path.join(self.folder, "features.bag")
        command = [drive_data.program("run_bag"), self.bag, "--output", output, "--quiet"]
        for size, options, lost in ((20000, ["--save-features", saved], saved),
                                    (40000, ["--save-map"], os.path.join(output, "map.bag"))):
            done = subprocess.run(command + options, check=False, timeout=LIMIT, stderr=subprocess.PIPE,
                                  preexec_fn=functools.partial(bound_files, size))
            self.assertEqual(1, done.returncode, done.stderr.decode())
            self.assertIn(lost + ": cannot be written", done.stderr.decode())
            left = os.listdir(self.folder) + (os.listdir(output) if os.path.isdir(output) else [])
            self.assertEqual([], [name for name in left if name.endswith(".tmp") or name == os.path.basename(lost)])

    def test_what_cannot_be_started_with_is_said(self):
        """Where a terminal shows it."""
        for name, value, word in (("image_transport", "compresed", "compresed"), ("image_transport", 3, "image_transport"),
                                  ("front_end", {"features": -1}, "front_end.features"),
                                  ("diagnostic_period", -1.0, "diagnostic_period must be a number of seconds")):
            self.set_parameters({name: value})
            done = subprocess.run([drive_data.program("stereo_front_end"), "__name:=" + NODE], check=False, timeout=LIMIT,
                                  stderr=subprocess.PIPE)
            self.assertEqual(1, done.returncode)
            self.assertIn(word, done.stderr.decode())

    @staticmethod
    def set_parameters(parameters):
        """Only these are the front end's."""
        if rospy.has_param("/" + NODE):
            rospy.delete_param("/" + NODE)
        for key, value in parameters.items():
            rospy.set_param("/%s/%s" % (NODE, key), value)

    def start_node(self, command, **parameters):
        """Runs the front end and waits until it listens."""
        self.set_parameters(dict({"diagnostic_period": 0.1}, **parameters))
        inputs = [p for topic, p in self.publishers.items() if topic != "velocity"]
        self.assertTrue(wait_for(lambda: not any(p.get_num_connections() for p in inputs)))  # the last one's
        node = subprocess.Popen(command + ["__name:=" + NODE], stdout=subprocess.DEVNULL)
        self.addCleanup(node.wait)
        self.addCleanup(node.kill)
        self.assertTrue(wait_for(lambda: all(p.get_num_connections() > 0 for p in inputs)))
        return node

    def play(self, drive, pause=0.01):
        """Publishes the messages, `pause` s (wall time) after each right image."""
        for topic, message in drive:
            self.publishers[topic].publish(message)
            time.sleep(pause if topic == "right/image" else 0.0)

    def counts(self, name):
        """Last values that /diagnostics gave of one part of the front end."""
        found = [s for report in self.reports for s in report.status if s.name == "%s: %s" % (NODE, name)]
        return {pair.key: pair.value for pair in found[-1].values} if found else {}

    def test_slam_launch_computes_what_run_bag_computes(self):
        """Byte for byte, as nodes and as nodelets of one manager, with a file that the configuration names beside it."""
        self.config = self.config_with_a_file_beside_it()
        expected, _ = self.run_bag()
        self.assertEqual(FRAMES, len(read(expected, "trajectory.tum").splitlines()))
        for kind in ("false", "true"):
            actual = os.path.join(self.folder, "nodelet_" + kind)
            status, said = self.launch("bag:=" + self.bag, "config:=" + self.config, "front_end:=true", "nodelet:=" + kind,
                                       "output_dir:=" + actual)
            self.assertEqual(0, status, said)
            for name in SAME_FILES:
                self.assertEqual(read(expected, name), read(actual, name), name + said)

    def test_a_last_pair_that_is_newer_than_the_last_gyro_sample(self):
        """Is waited for no longer once the bag is over."""
        end = self.drive[-4][1].header.stamp - rospy.Duration.from_sec(0.03)
        drive_data.write_bag(self.bag, [m for m in self.drive if m[0] != "imu" or m[1].header.stamp < end])
        expected, _ = self.run_bag()
        self.assertEqual(FRAMES, len(read(expected, "trajectory.tum").splitlines()))
        actual = os.path.join(self.folder, "launched")
        status, said = self.launch("bag:=" + self.bag, "config:=" + self.config, "front_end:=true", "output_dir:=" + actual)
        self.assertEqual(0, status, said)
        for name in SAME_FILES:
            self.assertEqual(read(expected, name), read(actual, name), name + said)

    def test_node_and_nodelet_send_the_features_of_run_bag_bit_for_bit(self):
        """Pixels, ids, noise, walk and descriptors."""
        _, expected = self.run_bag()
        self.assertEqual(FRAMES, len(expected))
        self.assertGreater(min(len(message.features) for message in expected), 60)
        features = [f for message in expected for f in message.features]
        self.assertTrue(all(len(f.descriptor) == 32 and f.sigma > 0.0 and f.walk >= 0.0 for f in features))
        self.assertTrue(any(f.walk > 0.0 for f in features), "no track had a new anchor")
        patient = {"buffer": {"max_delay_s": 5.0}, "ros": {"max_latency_s": 0.0}}
        for command in ([drive_data.program("stereo_front_end")],
                        [drive_data.program_of("nodelet", "nodelet"), "standalone", "vi_ekf_slam/StereoFrontEndNodelet"]):
            del self.features[:]
            node = self.start_node(command, **patient)
            self.play(self.drive)
            self.assertTrue(wait_for(lambda: len(self.features) == FRAMES), len(self.features))
            for wanted, got in zip(expected, self.features):
                self.assertEqual(wanted.header.stamp, got.header.stamp)
                self.assertEqual(wanted.header.frame_id, got.header.frame_id)
                self.assertEqual(list(map(contents, wanted.features)), list(map(contents, got.features)))
            node.terminate()
            node.wait()

    def test_images_that_come_too_fast_are_shed_and_counted(self):
        """Never queued: the newest pair is answered, and each is accounted for."""
        self.start_node([drive_data.program("stereo_front_end")])
        calm = self.drive[:40]
        self.play(calm)
        self.assertTrue(wait_for(lambda: self.features))
        frames = [m for m in self.drive if m[0] in ("left/image", "right/image")]
        for topic, message in self.drive:  # all gyro samples first; pairs that come before them wait, and are shed too
            if topic == "imu":
                self.publishers[topic].publish(message)
        sent = [m for m in frames if m[1].header.stamp > calm[-1][1].header.stamp]
        self.play(sent, pause=0.0)
        last = sent[-1][1].header.stamp
        self.assertTrue(wait_for(lambda: self.features[-1].header.stamp == last))
        reasons = ("images: pairs given up for newer ones", "images: left without a right one")
        self.assertTrue(wait_for(lambda: int(self.counts("images").get("pairs", 0)) + sum(
            int(self.counts("dropped").get(reason, 0)) for reason in reasons) == FRAMES),
                        (self.counts("images"), self.counts("dropped")))
        self.assertGreater(int(self.counts("dropped")[reasons[0]]), 0)
        self.assertTrue(wait_for(lambda: len(self.features) == int(self.counts("images")["pairs"])))

    def test_a_silent_camera_and_images_of_no_use_are_named(self):
        """One camera silent; black pictures; then all is well again."""
        self.start_node([drive_data.program("stereo_front_end")])
        silent = [m for m in self.drive[:60] if m[0] != "right/image"]
        self.play(silent)
        self.assertTrue(wait_for(lambda: "images: left without a right one" in self.counts("dropped")), self.counts("dropped"))
        self.assertEqual([], self.features)
        black = [(topic, Image(header=m.header, height=m.height, width=m.width, encoding=m.encoding, step=m.step,
                               data=bytes(len(m.data))) if topic == "left/image" else m) for topic, m in self.drive[60:100]]
        self.play(black)
        self.assertTrue(wait_for(lambda: int(self.counts("dropped").get("images: left picture: black", 0)) >= 2))
        self.play(self.drive[100:], pause=0.03)
        self.assertTrue(wait_for(lambda: self.features and len(self.features[-1].features) > 60))
        self.assertGreater(float(self.counts("images")["rate (Hz)"]), 0.0)

    def test_the_tracks_are_drawn_for_who_listens(self):
        """Left above right."""
        drawings = []
        listener = rospy.Subscriber("front_end/image", Image, drawings.append, queue_size=100)
        self.addCleanup(listener.unregister)
        self.start_node([drive_data.program("stereo_front_end")])
        self.assertTrue(wait_for(lambda: listener.get_num_connections() > 0))
        self.play(self.drive, pause=0.03)
        self.assertTrue(wait_for(lambda: drawings))
        self.assertEqual(("bgr8", image_data.WIDTH, 2 * image_data.HEIGHT),
                         (drawings[-1].encoding, drawings[-1].width, drawings[-1].height))


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "images", Images, sys.argv)
