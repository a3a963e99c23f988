"""What a bag or a running graph offers to rviz: topics with their types, frames, and which frames are connected."""

import time

from vi_ekf_slam.bag.opening import open_bag
from vi_ekf_slam.bag.transforms import root
from vi_ekf_slam.common.errors import InputError

TF_TOPICS = ("/tf", "/tf_static")
FEATURES = "/features"
PICTURES = {"/left/image": "raw", "/left/image/compressed": "compressed"}  # topic: its image_transport
DRIVE_TOPICS = ("/imu", "/velocity", FEATURES, *PICTURES)  # what slam_node or its front end needs under these names
TF_WAIT_S = 5.0  # wall time to listen to a graph for its frames


class Offer:
    """Topics {name: type}, frames (set), header frames of topics {topic: frame}, and where all that comes from."""

    def __init__(self, source, topics):
        self.source, self.topics = source, topics
        self.parents, self.headers = {}, {}
        self.start, self.end = 0.0, 0.0  # s, of a bag

    def add_transforms(self, message):
        """Take the frames of a tf2_msgs/TFMessage in."""
        for transform in message.transforms:
            self.parents[transform.child_frame_id.lstrip("/")] = transform.header.frame_id.lstrip("/")

    @property
    def frames(self):
        """All frames: those of TF and those that messages name."""
        return set(self.parents) | set(self.parents.values()) | set(self.headers.values())

    def connected(self, frame, other):
        """Whether the two are one frame or the transforms lead from one to the other."""
        return root(self.parents, frame) == root(self.parents, other)

    def is_drive(self, displays):
        """Whether these are a drive's measurements, without what a node makes of them. displays: [TopicDisplay]."""
        outputs = [d.topic for d in displays if d.topic in self.topics and not d.topic.startswith("/ground_truth/")]
        return not outputs and any(topic in self.topics for topic in DRIVE_TOPICS)

    def front_end(self):
        """Arguments of slam.launch with which features are made of a drive's pictures; none where it has features, or no pictures."""
        transport = next((PICTURES[topic] for topic in PICTURES if topic in self.topics), None)
        return ["front_end:=true", "image_transport:=" + transport] if transport and FEATURES not in self.topics else []


def read_bag(path, topics):
    """The Offer of a bag; header frames are read of `topics` and of /imu. InputError when it is no bag."""
    with open_bag(path) as bag:
        offer = Offer(path, {name: info.msg_type for name, info in bag.get_type_and_topic_info().topics.items()})
        if not offer.topics:
            raise ValueError("it is empty")
        offer.start, offer.end = bag.get_start_time(), bag.get_end_time()
        for topic in set(topics) | {"/imu"}:
            for _, message, _ in bag.read_messages([topic]):
                frame = _header_frame(message)
                if frame:
                    offer.headers[topic] = frame
                    break
        for _, message, _ in bag.read_messages([t for t in TF_TOPICS if t in offer.topics] or [""]):
            offer.add_transforms(message)
    return offer


def _header_frame(message):
    for part in [message] + list(getattr(message, "markers", [])):
        if hasattr(part, "header"):
            return part.header.frame_id.lstrip("/")
    return None


def read_graph(frames):
    """The Offer of the graph at ROS_MASTER_URI; listens to TF until all of `frames` came, TF_WAIT_S at most."""
    import rosgraph
    import rospy
    from tf2_msgs.msg import TFMessage
    master = rosgraph.Master("/export_rviz_config")
    try:
        offer = Offer("the graph at %s" % master.master_uri, dict(master.getTopicTypes()))
        published = {name for name, _ in master.getPublishedTopics("/")}
    except (OSError, rosgraph.MasterException) as reason:
        raise InputError("ROS_MASTER_URI is %s: no master answers there: %s" % (rosgraph.get_master_uri(), reason))
    offer.topics = {name: kind for name, kind in offer.topics.items() if name in published}
    if not any(topic in offer.topics for topic in TF_TOPICS):
        return offer
    rospy.init_node("export_rviz_config", anonymous=True, disable_signals=True, disable_rosout=True)
    listeners = [rospy.Subscriber(topic, TFMessage, offer.add_transforms, queue_size=1000) for topic in TF_TOPICS]
    end = time.monotonic() + TF_WAIT_S
    while not set(frames) <= offer.frames and time.monotonic() < end:
        time.sleep(0.05)
    for listener in listeners:
        listener.unregister()
    rospy.signal_shutdown("done")
    return offer
