#!/usr/bin/python3
"""Plays a bag for slam_node and ends when the node has answered all of it.

A thin shell around `rosbag play`: nothing is lost, because the player waits for its listeners and never drops, and the
process ends (so that roslaunch, where it is a required node, shuts down and the node saves) only when the node's
odometry has reached the last frame of the bag or nothing moves any more.
"""

import os
import signal
import subprocess
import sys
import time

import rosbag
import rosgraph
import rospy
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock

MEASUREMENTS = ("imu", "velocity", "features")
INPUTS = MEASUREMENTS + ("twist_bias", "left/camera_info", "right/camera_info", "/tf", "/tf_static")
# What the node itself sends, and what belongs to the recording session, is not played again.
NOT_PLAYED = ("odometry", "pose", "path", "dead_reckoning/path", "landmarks", "landmark_cloud", "/clock", "/diagnostics",
              "/diagnostics_agg", "/rosout", "/rosout_agg")
# A recorder that has not subscribed by then (wall time) will not.
WAIT_S = 30.0
# Nothing moved for this long (wall time): the bag is over and what the node has not answered it will not answer.
QUIET_S = 5.0


class PlayError(Exception):
    """The bag cannot be played; the message says why."""


def find_bag(path):
    """Absolute path of the bag; a relative one is tried from where roslaunch was started (PWD) too."""
    for folder in (os.getcwd(), os.environ.get("PWD", "")):
        candidate = os.path.join(folder, os.path.expanduser(path))
        if os.path.isfile(candidate):
            return os.path.abspath(candidate)
    raise PlayError("bag %r: no such file" % path)


def read_contents(path):
    """(topics in the bag, {topic: header stamp of its last message} of the measurements, time at which the bag ends)."""
    measurements = [rospy.resolve_name(name) for name in MEASUREMENTS]
    try:
        with rosbag.Bag(path) as bag:
            topics = sorted(bag.get_type_and_topic_info().topics)
            last, end = {}, rospy.Time()
            if topics:
                end = rospy.Time.from_sec(bag.get_end_time())
                start = max(bag.get_start_time(), bag.get_end_time() - 5.0)
                for topic, message, _ in bag.read_messages(measurements, start_time=rospy.Time.from_sec(start)):
                    last[topic] = max(last.get(topic, message.header.stamp), message.header.stamp)
    except (rosbag.ROSBagException, OSError) as error:
        raise PlayError("%s: cannot be read: %s (cut short? try 'rosbag reindex')" % (path, error)) from error
    if not any(name in topics for name in measurements):
        raise PlayError("%s: none of %s is in it; it has %s" %
                        (path, ", ".join(measurements), ", ".join(topics) or "nothing"))
    return topics, last, end


class Player:
    """rosbag play as a child, and what is heard of the node meanwhile."""

    def __init__(self, path, rate):
        self.topics, last, self.end = read_contents(path)
        # Without frames nothing says that the node is done: it may hold the last samples back for what could be late.
        self.goal = last.get(rospy.resolve_name("features"))
        self.answered = rospy.Time()
        self.clock = rospy.Time()
        self.last_move = None
        skip = {rospy.resolve_name(name) for name in NOT_PLAYED}
        inputs = {rospy.resolve_name(name) for name in INPUTS}
        played = [topic for topic in self.topics if topic not in skip]
        # rosbag waits for a listener on every topic; the rest (ground truth) may have none but us.
        self.listeners = [rospy.Subscriber(topic, rospy.AnyMsg, lambda _: None) for topic in played
                          if topic not in inputs]
        self.listeners.append(rospy.Subscriber("odometry", Odometry, self.on_odometry, queue_size=1000))
        self.listeners.append(rospy.Subscriber("/clock", Clock, self.on_clock, queue_size=100))
        command = ["rosbag", "play", "--clock", "--keep-alive", "--wait-for-subscribers", "--quiet", "--queue=0",
                   "--rate=%s" % rate, path, "--topics"] + played
        self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)

    def on_odometry(self, message):
        """The node has answered up to this stamp."""
        if message.header.stamp > self.answered:
            self.answered = message.header.stamp
            self.last_move = time.monotonic()

    def on_clock(self, message):
        """The player has played up to this time; its clock runs on when the bag is over."""
        if message.clock != self.clock:
            if self.clock <= self.end:
                self.last_move = time.monotonic()
            self.clock = message.clock

    def is_over(self):
        """Whether there is nothing left to wait for."""
        if self.goal is not None and self.answered >= self.goal:
            return True
        quiet = self.last_move is not None and time.monotonic() - self.last_move > QUIET_S
        if quiet and self.goal is not None:
            rospy.logwarn("play_bag: the bag is over; the node has answered up to %s, the last measurement is of %s",
                          self.answered, self.goal)
        return quiet

    def stop(self):
        """Ends the child and what it started."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGINT)
            try:
                self.process.wait(5.0)
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, signal.SIGKILL)
                self.process.wait()


def wait_for_listener(name):
    """Waits until the node of this name listens to the odometry, so that it misses nothing."""
    node, topic = rospy.resolve_name(name), rospy.resolve_name("odometry")
    master = rosgraph.Master(rospy.get_name())
    end = time.monotonic() + WAIT_S
    while not rospy.is_shutdown():
        listeners = dict(master.getSystemState()[1]).get(topic, [])
        if node in listeners:
            return
        if time.monotonic() > end:
            raise PlayError("%s does not listen to %s; listeners: %s" % (node, topic, ", ".join(listeners) or "none"))
        time.sleep(0.1)


def play(path, rate):
    """Plays to the end. Returns the exit code."""
    player = Player(path, rate)
    try:
        while not rospy.is_shutdown():
            if player.is_over():
                # Measurements after the last frame are under way still.
                time.sleep(0.5)
                return 0
            if player.process.poll() is not None:
                rospy.logerr("play_bag: rosbag play ended with code %d", player.process.returncode)
                return 2
            time.sleep(0.1)
    finally:
        player.stop()
    return 0


def main():
    """Entry point."""
    rospy.init_node("play_bag")
    try:
        rate = float(rospy.get_param("~rate", 1.0))
        if not 0.0 < rate < float("inf"):
            raise PlayError("~rate is %s; it must be a positive number" % rate)
        bag = find_bag(str(rospy.get_param("~bag")))
        if rospy.has_param("~wait_for"):
            wait_for_listener(str(rospy.get_param("~wait_for")))
        return play(bag, rate)
    except KeyError:
        rospy.logfatal("play_bag: the parameter ~bag is missing")
    except (PlayError, ValueError, rosgraph.MasterException) as error:
        rospy.logfatal("play_bag: %s", error)
    return 2


if __name__ == "__main__":
    sys.exit(main())
