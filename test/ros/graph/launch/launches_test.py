#!/usr/bin/env python3
"""slam.launch beside others: on one master after each other and at a time, with remapped topics, with a robot's own bag."""

import os
import subprocess
import sys

import rosbag
import rospy
import rostest
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

import drive_data
from launch_runner import PACKAGE, LaunchRunner
from waiting import wait_for

OUTPUTS = ("odometry", "dead_reckoning_odometry", "pose", "path", "dead_reckoning_path", "landmarks", "landmark_cloud",
           "loop_closures", "diagnostics")
INPUTS = ("imu", "velocity", "wheel_odometry", "twist_bias", "features", "left_info", "right_info", "initialpose", "tf",
          "tf_static")


def transform(stamp, parent, child):
    """The identity."""
    message = TransformStamped()
    message.header.stamp, message.header.frame_id, message.child_frame_id = stamp, parent, child
    message.transform.rotation.w = 1.0
    return message


def state():
    """([topics published by /slam of a namespace], [subscribed]) as {node: (set, set)}."""
    published, subscribed, _ = rospy.get_master().getSystemState()[2]
    found = {}
    for index, topics in enumerate((published, subscribed)):
        for topic, nodes in topics:
            for node in nodes:
                found.setdefault(node, (set(), set()))[index].add(topic)
    return found


class Launches(LaunchRunner):
    """All on the master of the test."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node("launches")

    def wait(self, condition, process=None):
        """Until `condition()`, or fails with what roslaunch says."""
        if not wait_for(condition, 30.0):
            self.fail(self.stop(process) if process else "in vain")

    def runs(self, node):
        """Whether it has subscribed to all its inputs."""
        return len(state().get(node, ((), ()))[1]) >= len(INPUTS)

    def play_here(self, *arguments):
        """Plays the bag on the test's master; returns what was said."""
        process = self.start("bag:=" + self.bag, "config:=" + self.config, "rate:=4", *arguments)
        said = self.finish(process)
        self.assertEqual(0, process.returncode, said)
        self.assertNotIn("REQUIRED", said)
        return said

    def check_every_frame_is_saved(self, begin, end):
        """The trajectory has a pose for each frame of the drive between these stamps (s), and no other."""
        stamps = [drive_data.stamp_of(m).to_sec() for topic, m in drive_data.drive() if topic == "features"]
        with open(os.path.join(self.folder, "drive_slam", "trajectory.tum"), encoding="ascii") as file:
            saved = [float(line.split()[0]) for line in file]
        self.assertEqual([stamp for stamp in stamps if begin <= stamp <= end], saved)

    def test_a_live_launch_after_one_with_a_bag(self):
        """What the bag needed is gone, and what somebody left below the name too."""
        rospy.set_param("/slam/left_behind", 1)
        self.play_here()
        self.assertEqual({"max_delay_s": 10.0, "max_jump_s": 60.0}, rospy.get_param("/slam/buffer"))
        process = self.start("config:=" + self.config)
        self.wait(lambda: self.runs("/slam"), process)
        self.assertFalse(rospy.get_param("/use_sim_time"))
        self.assertFalse(rospy.has_param("/slam/buffer"))
        self.assertFalse(rospy.has_param("/slam/left_behind"))
        self.stop(process)

    def test_two_in_two_namespaces(self):
        """Each has its own inputs and outputs, and one ends without the other."""
        first, second = (self.start("config:=" + self.config, "ns:=" + ns) for ns in ("first", "second"))
        self.wait(lambda: self.runs("/first/slam") and self.runs("/second/slam"), first)
        heard = {ns: [] for ns in ("first", "second")}
        listeners = [rospy.Subscriber("/%s/odometry" % ns, Odometry, heard[ns].append, queue_size=1000) for ns in heard]
        publishers = {ns: {topic: rospy.Publisher(topic if topic[0] == "/" else "/%s/%s" % (ns, topic), type(message),
                                                  queue_size=1000, latch=topic == "/tf_static")
                           for topic, message in drive_data.drive(0.0)} for ns in heard}
        self.wait(lambda: all(p.get_num_connections() for topics in publishers.values() for p in topics.values()))
        self.wait(lambda: all(listener.get_num_connections() for listener in listeners))

        def send(ns, start):
            for topic, message in drive_data.drive(1.0, start):
                publishers[ns][topic].publish(message)
        send("first", 1000.0)
        self.wait(lambda: heard["first"])
        self.assertEqual([], heard["second"])
        said = self.stop(first)
        send("second", 2000.0)
        self.wait(lambda: heard["second"])
        self.assertTrue(all(m.header.stamp.to_sec() < 1500.0 for m in heard["first"]), said)
        self.stop(second)

    def test_every_topic_can_have_another_name(self):
        """Inputs and outputs."""
        names = {name: "/other/" + name for name in OUTPUTS + INPUTS}
        process = self.start("config:=" + self.config, *("%s:=%s" % pair for pair in names.items()))
        self.wait(lambda: self.runs("/slam"), process)
        published, subscribed = state()["/slam"]
        self.assertLessEqual({names[name] for name in INPUTS}, subscribed)
        self.wait(lambda: {names[name] for name in OUTPUTS + ("tf",)} <= state()["/slam"][0], process)
        ours = {topic for topic in published | subscribed if not topic.startswith("/slam/")}
        self.assertLessEqual(ours, set(names.values()) | {"/rosout", "/clock"})
        self.stop(process)

    def test_a_configuration_names_files_beside_it(self):
        """Node and nodelet find them, wherever they run."""
        config = self.config_with_a_file_beside_it()
        for nodelet in ("false", "true"):
            process = self.start("config:=" + config, "nodelet:=" + nodelet)
            self.wait(lambda: self.runs("/slam"), process)
            self.stop(process)
            self.wait(lambda: "/slam" not in state())

    def test_foreign_parameters_are_a_warning(self):
        """Named; the node starts."""
        heard = []
        listener = rospy.Subscriber("/rosout_agg", Log, heard.append, queue_size=100)
        rospy.set_param("/foreign/somebodys", {"parameter": 1})
        node = subprocess.Popen([drive_data.program("slam_node"), "__name:=foreign"], stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT)
        self.addCleanup(node.kill)
        self.wait(lambda: self.runs("/foreign"))
        node.terminate()
        said = node.communicate(timeout=20)[0].decode()
        self.assertEqual(0, node.returncode, said)
        self.assertIn("/foreign/somebodys", said)
        listener.unregister()

    def test_in_a_manager_that_is_there(self):
        """The nodelet is loaded into it and answers; the manager outlives it."""
        manager = subprocess.Popen([drive_data.program_of("nodelet", "nodelet"), "manager", "__name:=manager"],
                                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.addCleanup(manager.wait)
        self.addCleanup(manager.kill)
        self.wait(lambda: "/manager" in state())
        self.play_here("manager:=manager")
        self.assertIsNone(manager.poll())
        self.check_every_frame_is_saved(1000.0, 1006.0)

    def test_a_part_of_the_bag(self):
        """From 2 s on for 3 s, with what is latched before."""
        drive_data.write_bag(self.bag, drive_data.drive(gyro_per_frame=2), latched=True)
        self.play_here("start:=2", "duration:=3")
        self.check_every_frame_is_saved(1002.0, 1005.0)
        with open(os.path.join(self.folder, "drive_slam", "landmarks.csv"), encoding="ascii") as file:
            self.assertGreater(len(file.readlines()), 10)  # features were used

    def test_frames_are_arguments(self):
        """They take the place of the configuration's; what is not given is left alone."""
        process = self.start("config:=" + self.config, "base_frame:=cart", "odom_frame:=drift", "map_frame:=town",
                             "publish_map_tf:=false", "publish_odom_tf:=false", "transform_tolerance:=0.5")
        self.wait(lambda: self.runs("/slam"), process)
        self.assertEqual({"landmark_period_s": 0.5, "base_frame": "cart", "odom_frame": "drift", "map_frame": "town",
                          "publish_map_tf": False, "publish_odom_tf": False, "transform_tolerance": 0.5},
                         rospy.get_param("/slam/ros"))
        self.stop(process)

    def robots_bag(self, transforms):
        """Recorded with all topics while a node ran that sent, or heard, `transforms` ([(parent, child)])."""
        with rosbag.Bag(self.bag, "w") as bag:
            for topic, message in drive_data.drive():
                stamp = drive_data.stamp_of(message)
                bag.write("/" + topic.lstrip("/"), message, stamp)
                if topic != "features":
                    continue
                bag.write("/tf", TFMessage([transform(stamp, *frames) for frames in transforms]), stamp)
                for name in ("/odometry", "/dead_reckoning/odometry"):
                    bag.write(name, Odometry(header=message.header, child_frame_id="old"), stamp)
                bag.write("/initialpose", PoseWithCovarianceStamped(header=message.header), stamp)
                bag.write("/slam/private", String("old"), stamp)
                bag.write("/moved/odometry", Odometry(header=message.header, child_frame_id="old"), stamp,
                          connection_header={"topic": "/moved/odometry", "callerid": "/slam", "type": Odometry._type,
                                             "md5sum": Odometry._md5sum, "message_definition": Odometry._full_text})
                bag.write("/robot/odometry", Odometry(header=message.header, child_frame_id="wheels"), stamp)

    def play_and_listen(self, *arguments):
        """Plays the robot's bag; returns ({topic: messages}, {child: stamps in /tf})."""
        kinds = {"/tf": TFMessage, "/odometry": Odometry, "/dead_reckoning/odometry": Odometry, "/slam/private": String,
                 "/moved/odometry": Odometry, "/robot/odometry": Odometry, "/initialpose": PoseWithCovarianceStamped}
        heard = {topic: [] for topic in kinds}
        listeners = [rospy.Subscriber(topic, kinds[topic], heard[topic].append, queue_size=10000) for topic in kinds]
        said = self.play_here(*arguments)
        def stamps():
            found = {}
            for sent in (t for message in heard["/tf"] for t in message.transforms):
                found.setdefault(sent.child_frame_id, []).append(sent.header.stamp)
            return found
        # Some may be played before we listen, the last ones are not.
        end = rospy.Time(1006)
        self.wait(lambda: heard["/robot/odometry"] and heard["/robot/odometry"][-1].header.stamp == end)
        self.wait(lambda: all(end in of_child for of_child in stamps().values()))
        for listener in listeners:
            listener.unregister()
        self.assertEqual([], heard["/slam/private"] + heard["/moved/odometry"] + heard["/initialpose"], said)
        for child, of_child in stamps().items():
            self.assertEqual(len(of_child), len(set(of_child)), child)
        return heard, stamps()

    def test_a_robots_own_bag(self):
        """The answers of the node that ran then are not played again, all else is."""
        self.robots_bag([("map", "odom"), ("odom", "imu_link"), ("imu_link", "wheel"), ("odom", "marker")])
        heard, stamps = self.play_and_listen()
        for topic in ("/odometry", "/dead_reckoning/odometry"):
            self.assertEqual({"imu_link"}, {m.child_frame_id for m in heard[topic]})
        self.assertEqual({"odom", "imu_link", "wheel", "marker"}, set(stamps))

    def test_a_robots_own_bag_with_a_base(self):
        """The base's transform is the node's too; the correction of another localisation stays."""
        base = TFMessage([drive_data.base_extrinsic(rospy.Time(1000))])
        self.robots_bag([("map", "odom"), ("odom", "base_link"), ("base_link", "wheel")])
        with rosbag.Bag(self.bag, "a") as bag:  # whose last chunk is not the latest then
            bag.write("/tf_static", base, rospy.Time(1000))
        heard, stamps = self.play_and_listen("base_frame:=base_link", "publish_map_tf:=false")
        self.assertEqual({"base_link"}, {m.child_frame_id for m in heard["/dead_reckoning/odometry"]})
        self.assertEqual({"odom", "base_link", "wheel"}, set(stamps))
        moved = [t.transform.translation.y for m in heard["/tf"] for t in m.transforms if t.child_frame_id == "base_link"]
        self.assertGreater(max(moved), 3.0)  # those of the bag are the identity


if __name__ == "__main__":
    rostest.rosrun(PACKAGE, "launches", Launches, sys.argv)
