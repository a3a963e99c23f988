"""The node behind slam.launch record:=true: what slam_node publishes, as a bag that rviz can show without slam_node.

`rosbag record` would store the whole path with every pose of it, and the whole map, which grows with the square of the
drive's length. Here such topics are thinned, and their last message is never lost.
"""

import os
import sys
import tempfile
import threading

import rosbag
import rosgraph
import rospy

from vi_ekf_slam.bag.connections import stored
from vi_ekf_slam.common.exit_status import EXIT_REFUSED
from vi_ekf_slam.ros.node_arguments import take_ros_arguments

TOPICS = ("/tf", "/tf_static", "odometry", "dead_reckoning/odometry", "pose", "loop_closures", "/ground_truth/pose",
          "/diagnostics")
# Each message holds all of the path or of the map so far, or is a picture. They are written so often only that the bag
# grows steadily.
THINNED = ("path", "dead_reckoning/path", "/ground_truth/path", "landmarks", "landmark_cloud", "front_end/image")
THINNED_PERIOD_S = 0.9  # at least; less than the second between two maps
THINNED_BYTES_PER_S = 5e4  # of each topic
QUEUE = 10000


class OutputRecorder:
    """Writes FILE.active and calls it FILE when it is closed, as rosbag record does: a crash leaves what there is.

    Messages are stored under the time (ROS time) at which they came. The flag of latched topics goes into the bag.
    Without a message there is no file, and its folder is not made. What cannot be written ends the recording, not the node:
    FILE.active stays, for `rosbag reindex`.
    """

    def __init__(self, path):
        _require_writable(path)
        self.path = path
        self.lock = threading.Lock()
        self.bag = None  # before the first message
        self.closed = self.failed = False
        self.written = {}  # topic: time at which a thinned one was last written
        self.early = []  # [(topic, message)] that came before the time did
        self.held = {}  # topic: (message, time) that was not written, newer than what was
        self.subscribers = [self._subscribe(rospy.resolve_name(name), name in THINNED) for name in TOPICS + THINNED]

    def _subscribe(self, topic, thinned):
        return rospy.Subscriber(topic, rospy.AnyMsg, self.on_message, (topic, thinned), queue_size=QUEUE)

    def on_message(self, message, subscription):
        """Writes it, or holds it back when the topic is thinned and was written a moment ago."""
        topic, thinned = subscription
        now = rospy.get_rostime()
        with self.lock:
            if self.closed:
                return
            if now == rospy.Time():  # simulated time has not begun
                self.early.append((topic, message))
                return
            try:
                self._take(topic, thinned, message, now)
            except OSError as error:  # a disk that is full, mostly
                self.closed = self.failed = True
                rospy.logfatal("record_outputs: %s: %s; nothing more is recorded", self.path, error.strerror)

    def _take(self, topic, thinned, message, now):
        self._write_early(now)
        since = (now - self.written[topic]).to_sec() if topic in self.written else None
        period = max(THINNED_PERIOD_S, len(message._buff) / THINNED_BYTES_PER_S)
        if thinned and since is not None and 0.0 <= since < period:
            self.held[topic] = message, now
            return
        self._write(topic, message, now)

    def _write_early(self, time):
        for topic, message in self.early:
            self._write(topic, message, time)
        self.early = []

    def _write(self, topic, message, time):
        header = dict(message._connection_header, topic=topic)
        if self.bag is None:
            os.makedirs(os.path.dirname(self.path), exist_ok=True)
            self.bag = rosbag.Bag(self.path + ".active", "w")
        raw = header["type"], message._buff, header["md5sum"], None
        self.bag.write(topic, raw, time, raw=True, connection_header=stored(header))
        self.written[topic] = time
        self.held.pop(topic, None)

    def close(self):
        """Writes what was held back and gives the bag its name; whether there is one. None is if time never began."""
        with self.lock:
            self.closed = True
            if self.bag is None or self.failed:
                return False
            for topic, (message, time) in list(self.held.items()):
                self._write(topic, message, time)
            self.bag.close()
            os.replace(self.path + ".active", self.path)
            return True


def _require_writable(path):
    """OSError unless the file can be made, with the folders that are missing."""
    if os.path.isdir(path):
        raise OSError("%s: is a folder, allowed: the file to write" % path)
    folder = os.path.dirname(path)
    while not os.path.exists(folder):
        folder = os.path.dirname(folder)
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OSError("%s: cannot be made in %s: %s" % (path, folder, error.strerror)) from error


def main():
    """Entry point: records until the node is shut down."""
    take_ros_arguments(__doc__)
    rospy.init_node("record_outputs")
    try:
        path = os.path.abspath(os.path.expanduser(str(rospy.get_param("~bag"))))
        recorder = OutputRecorder(path)
    except KeyError:
        rospy.logfatal("record_outputs: the parameter ~bag is missing; allowed: the file to write")
        return EXIT_REFUSED
    except (OSError, rosgraph.MasterException) as error:
        rospy.logfatal("record_outputs: %s", error)
        return EXIT_REFUSED
    try:
        rospy.spin()
    finally:
        if recorder.close():
            print("record_outputs: wrote %s" % path, file=sys.stderr)
    return EXIT_REFUSED if recorder.failed else 0
