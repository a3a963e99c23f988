"""Record the topics that are published now, with the times at which they came, as a bag for the same checks."""

import threading
import time

from vi_ekf_slam.bag import topics as names
from vi_ekf_slam.bag.connections import stored
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.stop_signals import end_if_told

STATIC = ("/tf_static", "/tf")
QUEUE = 10000
MAX_BYTES = 4e9  # of pictures: what a temporary folder may hold


def record(path, options):
    """Write what comes within options.live s to `path`. InputError without a master, any topic or any message."""
    import rosgraph
    import rospy
    if not rosgraph.is_master_online():
        raise InputError("no ROS master answers at %s (ROS_MASTER_URI)" % rosgraph.get_master_uri())
    rospy.init_node("check_rig", anonymous=True, disable_signals=True)
    present = dict(rospy.get_published_topics())
    chosen, _ = names.assign(present, names.parse_remappings(options.remap))
    if not chosen:
        raise InputError("no topic of a rig is published; there are: %s" % (", ".join(sorted(present)) or "none"))
    writer = _Writer(path)
    wanted = sorted(set(chosen.values()) | {topic for topic in STATIC if topic in present})
    subscribers = [rospy.Subscriber(topic, rospy.AnyMsg, writer.write, topic, queue_size=QUEUE, tcp_nodelay=True) for topic in wanted]
    end = time.monotonic() + options.live
    while time.monotonic() < end and not rospy.is_shutdown():
        end_if_told()
        time.sleep(min(0.1, max(0.0, end - time.monotonic())))
    for subscriber in subscribers:
        subscriber.unregister()
    if not writer.close():
        raise InputError("nothing was published in %g s on %s, at %s (ROS_MASTER_URI)"
                         % (options.live, ", ".join(wanted), rosgraph.get_master_uri()))


class _Writer:
    """A bag whose record times are the wall clock's: simulated time would hide what is late."""

    def __init__(self, path):
        import rosbag
        self._bag, self._lock, self._bytes = rosbag.Bag(path, "w"), threading.Lock(), 0

    def write(self, message, topic):
        """As it came, without unpacking it."""
        import genpy
        now = time.time()
        header = dict(message._connection_header, topic=topic)
        raw = header["type"], message._buff, header["md5sum"], None
        with self._lock:
            if self._bag is None or self._bytes > MAX_BYTES:
                return
            self._bytes += len(message._buff)
            self._bag.write(topic, raw, genpy.Time.from_sec(now), raw=True, connection_header=stored(header))

    def close(self):
        """No more is written; how many bytes were."""
        with self._lock:
            self._bag.close()
            self._bag = None
            return self._bytes
