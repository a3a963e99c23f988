"""The node behind slam.launch bag:=FILE: plays the bag, and ends roslaunch when slam_node has answered all of it.

A shell around rosbag's player: nothing is lost, because it waits for its listeners, never drops, and waits for a slam_node that
cannot follow before its queue is full. slam_node and the recorder save what they have when roslaunch ends them. A bag that
cannot be played ends this node with status 2.
"""

import os
import subprocess
import time

import rosgraph
import rospy
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import Odometry
from roslib.packages import find_node
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage

from vi_ekf_slam.bag.connections import STATIC_TOPIC
from vi_ekf_slam.ros.node_arguments import take_ros_arguments
from vi_ekf_slam.ros.own_launch import end_own_launch
from vi_ekf_slam.ros.recorded_bag import TRANSFORMS, OwnTransforms, PlayError, RecordedBag, find_bag

# A recorder that has not subscribed by then (wall time) will not.
START_LIMIT_S = 30.0
# Nothing moved for this long (wall time) after the end of the bag: what the node has not answered it will not answer.
QUIET_S = 5.0
# Beside what it waits for inputs, slam_node waits this long (sensor time) for the first messages of an IMU.
FIRST_WAIT_S = 1.0
# s of the bag that may wait in slam_node, beside what it holds back for what could be late.
LEAD_S = 10.0
# A node that has answered nothing for this long (wall time) is not waited for.
ANSWER_LIMIT_S = 10.0
# What comes over one connection may be this much later than what comes over another (wall time).
CONNECTION_DELAY_S = 0.2


class Progress:
    """Up to which time of the bag slam_node has answered. In s.

    Its answers have the stamps of its inputs, which may be of another clock than the bag's times: between the two is what was least.
    """

    def __init__(self, lead):
        self.lead, self.stamp, self.offset, self.heard_at = lead, None, float("inf"), 0.0

    def on_answer(self, stamp, clock, now):
        """The node has answered what has this stamp while the bag was at `clock`, at `now` of the wall's clock."""
        self.offset = min(self.offset, clock - stamp)
        self.stamp, self.heard_at = stamp, now

    def answered(self, clock, now):
        """A node that is silent has nothing to answer: it has not begun, its camera was out, its stamps went back, or it has died."""
        if self.stamp is None:
            return clock
        if clock > self.stamp + self.offset + self.lead and now > self.heard_at + ANSWER_LIMIT_S:
            self.offset = clock - self.stamp
        return min(clock, self.stamp + self.offset)


class Player:
    """rosbag's player as a child, and what is heard of slam_node meanwhile. Use as a context: its end ends the child."""

    def __init__(self, bag, node, rate, window):
        self.goal, self.end = bag.goal, bag.end
        held_s = float(rospy.get_param(node + "/buffer/max_delay_s", 0.0)) + FIRST_WAIT_S
        self.is_held = bag.duration <= held_s
        self.progress = Progress(held_s + LEAD_S)
        self.progress_topic = rospy.Publisher("~answered", PointStamped, queue_size=1, latch=True)
        self.answered, self.clock, self.last_move = rospy.Time(), rospy.Time(), None
        # The player waits for a listener on every topic; the foreign ones may have none but us.
        self.stand_ins = [rospy.Subscriber(topic, rospy.AnyMsg, lambda _: None) for topic in bag.unheard]
        self.own_transforms = OwnTransforms(node, bag.imu_frame)
        self.transforms = rospy.Publisher(TRANSFORMS, TFMessage, queue_size=1000) if TRANSFORMS in bag.played else None
        self.listeners = [rospy.Subscriber("odometry", Odometry, self.on_odometry, queue_size=1000),
                          rospy.Subscriber("/clock", Clock, self.on_clock, queue_size=100),
                          rospy.Subscriber("~tf", TFMessage, self.on_transforms, queue_size=1000)]
        self.command = ending_with(os.getpid(), [
            find_node("rosbag", "play")[0], "--clock", "--keep-alive", "--wait-for-subscribers", "--quiet", "--queue=0",
            "--rate=%s" % rate, "--rate-control-topic=" + rospy.resolve_name("~answered"),
            "--rate-control-max-delay=%s" % self.progress.lead] + window + ["--topics"] + bag.played + [
                "--bags", bag.path, "%s:=%s" % (TRANSFORMS, rospy.resolve_name("~tf")),
                "%s:=%s" % (STATIC_TOPIC, rospy.resolve_name(STATIC_TOPIC))])
        self.process = None

    def __enter__(self):
        self.process = subprocess.Popen(self.command, stdin=subprocess.DEVNULL)
        return self

    def __exit__(self, *_):
        self.process.kill()  # it has nothing to save, and while it waits for its listeners it hears no SIGINT
        self.process.wait()

    def on_odometry(self, message):
        """The node has answered up to this stamp."""
        if self.clock != rospy.Time():
            self.progress.on_answer(message.header.stamp.to_sec(), self.clock.to_sec(), time.monotonic())
        if message.header.stamp > self.answered:
            self.answered = message.header.stamp
            self.last_move = time.monotonic()

    def on_clock(self, message):
        """The player has played up to this time; its clock runs on when the bag is over, and is sent while the player is paused too."""
        if self.clock <= self.end:
            self.last_move = time.monotonic()
        self.clock = message.clock

    def on_transforms(self, message):
        """Passes on what slam_node does not send itself."""
        foreign = [transform for transform in message.transforms if transform not in self.own_transforms]
        if foreign:
            self.transforms.publish(TFMessage(foreign))

    def tell_progress(self):
        """The player waits where its clock is further than the lead beyond this."""
        message = PointStamped()
        message.header.stamp = rospy.Time.from_sec(max(0.0, self.progress.answered(self.clock.to_sec(), time.monotonic())))
        if self.clock != rospy.Time():  # until then the player takes its beginning
            self.progress_topic.publish(message)

    def is_over(self):
        """Whether there is nothing left to wait for."""
        if self.clock != rospy.Time():  # it plays: images need not come here
            for stand_in in self.stand_ins:
                stand_in.unregister()
            self.stand_ins = []
        if self.goal is not None and self.answered >= self.goal:
            return True
        quiet = self.last_move is not None and time.monotonic() - self.last_move > QUIET_S
        if quiet and self.goal is not None:
            self.tell_of_the_end()
        return quiet

    def tell_of_the_end(self):
        """Of a bag whose last measurement is not answered yet: so short that the node still waits for what it lacks, or a fault."""
        if self.is_held and self.answered == rospy.Time():
            rospy.loginfo("play_bag: the bag is over; what is so short is computed when the node ends")
        else:
            rospy.logwarn("play_bag: the bag is over; the node has answered up to %s, the last measurement is of %s",
                          self.answered, self.goal)


def ending_with(parent, command):
    """The command as one that does not outlive `parent`, the process that starts it, whatever ends that."""
    # What ends before setpriv has asked for the signal is not its parent any more.
    return ["setpriv", "--pdeathsig", "KILL", "--", "sh", "-c", '[ "$PPID" = "$0" ] && exec "$@"', str(parent)] + command


def wait_for_listener(topic, node=None):
    """Waits until the node (None: any) listens to the topic, so that it misses nothing."""
    master = rosgraph.Master(rospy.get_name())
    end = time.monotonic() + START_LIMIT_S
    while not rospy.is_shutdown():
        listeners = dict(master.getSystemState()[1]).get(topic, [])
        if node in listeners or (node is None and listeners):
            return
        if time.monotonic() > end:
            raise PlayError("%s does not listen to %s" % (node or "stereo_front_end", topic))
        time.sleep(0.1)


def number(name, is_allowed, allowed):
    """The private parameter as a number."""
    value = rospy.get_param("~" + name)
    try:
        result = float("nan") if isinstance(value, bool) else float(value)  # 1e9 comes as a text: it is one in YAML
    except (TypeError, ValueError):
        result = float("nan")
    if not is_allowed(result):
        raise PlayError("~%s is %s, allowed: %s" % (name, value, allowed))
    return result


def limited(rate, max_delay_s):
    """The rate, or the highest at which slam_node, which waits for `max_delay_s` of the bag, does not call messages late."""
    highest = max_delay_s / CONNECTION_DELAY_S
    if not 0.0 < highest < rate:
        return rate
    rospy.logwarn("play_bag: ~rate is %g; played at %g, above which messages come too late from one another (run_bag is faster)",
                  rate, highest)
    return highest


def play():
    """Plays to the end; PlayError where that is not reached."""
    rate = number("rate", lambda x: 0.0 < x < float("inf"), "a positive number")
    start = number("start", lambda x: 0.0 <= x < float("inf"), "s, not negative")
    duration = number("duration", lambda x: 0.0 <= x < float("inf"), "s, not negative; 0: to the end")
    node = rospy.resolve_name("slam")
    rate = limited(rate, float(rospy.get_param(node + "/buffer/max_delay_s", 0.0)))
    transport = str(rospy.get_param("~image_transport", "raw")) if rospy.get_param("~front_end", False) else None
    gyro_wait_s = float(rospy.get_param("front_end/buffer/max_delay_s", 0.0))
    bag = RecordedBag(find_bag(str(rospy.get_param("~bag"))), node, start, duration, transport, gyro_wait_s)
    if bag.advice:
        rospy.logwarn("play_bag: %s", bag.advice)
    if rospy.get_param("~recorded", False):
        wait_for_listener(rospy.resolve_name("odometry"), rospy.resolve_name("record_outputs"))
    if transport is not None:
        wait_for_listener(bag.frames[-1])  # what it subscribes to last; the player waits for one listener of each topic alone
    window = ["--start=%s" % start] + (["--duration=%s" % duration] if duration else [])
    with Player(bag, node, rate, window) as player:
        while not rospy.is_shutdown() and not player.is_over():
            if player.process.poll() is not None:
                raise PlayError("rosbag's player ended with status %d" % player.process.returncode)
            player.tell_progress()
            time.sleep(0.1)
        time.sleep(0.5)  # measurements after the last frame are under way still


def main():
    take_ros_arguments(__doc__)
    rospy.init_node("play_bag")
    try:
        play()
        if not rospy.is_shutdown():
            end_own_launch()
        return 0
    except KeyError as error:
        rospy.logfatal("play_bag: the parameter %s is missing", error)
    except (PlayError, rosgraph.MasterException) as error:
        rospy.logfatal("play_bag: %s", error)
    return 2
