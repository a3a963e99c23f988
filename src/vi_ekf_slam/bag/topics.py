"""Which topic carries what: the names that were given, or what can be told from types and names."""

from vi_ekf_slam.common.errors import InputError

TYPES = {
    "imu": ("sensor_msgs/Imu",),
    "velocity": ("geometry_msgs/TwistWithCovarianceStamped",),
    "wheel_odometry": ("nav_msgs/Odometry",),
    "features": ("vi_ekf_slam/StereoFeatureArray",),
    "left_image": ("sensor_msgs/Image", "sensor_msgs/CompressedImage"),
    "right_image": ("sensor_msgs/Image", "sensor_msgs/CompressedImage"),
    "left_info": ("sensor_msgs/CameraInfo",),
    "right_info": ("sensor_msgs/CameraInfo",),
}
# The arguments of slam.launch and what they are without one.
DEFAULTS = {"imu": "/imu", "velocity": "/velocity", "wheel_odometry": "/wheel_odometry", "features": "/features",
            "left_image": "/left/image", "right_image": "/right/image", "left_info": "/left/camera_info",
            "right_info": "/right/camera_info"}
# Words in the topics of usual drivers: RealSense, OAK, ZED, EuRoC's bags, KITTI's.
SIDES = {"left": ("left", "infra1", "cam0", "image_00", "cam_0", "camera0"),
         "right": ("right", "infra2", "cam1", "image_01", "cam_1", "camera1")}
NOT_INPUTS = ("/ground_truth", "odometry/filtered", "dead_reckoning")
COMPRESSED = "/compressed"


def parse_remappings(words):
    """{argument: topic} of "NAME:=TOPIC" as slam.launch takes them; InputError names what it does not know."""
    given = {}
    for word in words:
        name, separator, topic = word.partition(":=")
        if not separator or name not in DEFAULTS or not topic:
            raise InputError("'%s', allowed: NAME:=TOPIC with NAME of %s" % (word, ", ".join(sorted(DEFAULTS))))
        given[name] = topic if topic.startswith("/") else "/" + topic
    return given


def assign(present, given):
    """({argument: topic}, {argument: topic that was guessed}) of what is there. present: {topic: type}."""
    chosen, guessed = {}, {}
    for name, types in TYPES.items():
        topic = given.get(name, DEFAULTS[name])
        found = next((t for t in (topic, topic + COMPRESSED) if present.get(t) in types), None)
        if found is None and name not in given and name != "wheel_odometry":
            found = _guess(name, {t for t, kind in present.items() if kind in types})
            if found is not None:
                guessed[name] = found
        if found is not None:
            chosen[name] = found
    return chosen, guessed


def _guess(name, topics):
    """The only topic that can be meant, or None."""
    topics = {topic for topic in topics if not any(word in topic for word in NOT_INPUTS)}
    side = name.split("_")[0]
    if side in SIDES:
        topics = {topic for topic in topics if any(word in topic for word in SIDES[side])}
        plain = {topic for topic in topics if not topic.endswith(COMPRESSED)}
        topics = plain or topics
    return topics.pop() if len(topics) == 1 else None


def argument(name, topic):
    """How slam.launch is told of a topic; image topics without the transport."""
    return "%s:=%s" % (name, topic[:-len(COMPRESSED)] if topic.endswith(COMPRESSED) else topic)
