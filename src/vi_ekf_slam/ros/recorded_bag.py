"""What of a robot's bag is played to slam_node: the inputs and what is foreign, not the answers of an earlier run."""

import os

import rosbag
import rospy
from geometry_msgs.msg import TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu
from tf2_msgs.msg import TFMessage

from vi_ekf_slam.bag.connections import STATIC_TOPIC
from vi_ekf_slam.msg import StereoFeatureArray

MEASUREMENTS = {"imu": Imu, "velocity": TwistWithCovarianceStamped, "wheel_odometry": Odometry,
                "features": StereoFeatureArray}
INPUTS = dict(MEASUREMENTS, **{"twist_bias": TwistWithCovarianceStamped, "left/camera_info": CameraInfo,
                               "right/camera_info": CameraInfo})
# What the node itself sends, and what belongs to the recording session, as where somebody told it to be.
IMAGES = ("left/image", "right/image")
NOT_PLAYED = ("odometry", "dead_reckoning/odometry", "pose", "path", "dead_reckoning/path", "landmarks", "landmark_cloud",
              "loop_closures", "initialpose", "front_end/image", "/clock", "/diagnostics", "/diagnostics_agg", "/rosout", "/rosout_agg")
TRANSFORMS = "/tf"
IMAGE_KINDS = {"raw": Image, "compressed": CompressedImage}  # by transport; of another one only its plugin knows
LAST_S = 5.0  # s before the end, within which the last message of each measurement is looked for


class PlayError(Exception):
    """The bag cannot be played; the message says why."""


class RecordedBag:
    """The contents of the bag from `start` s after its beginning on, for `duration` s (0: to its end).

    transport: how the images come of which the front end makes features; None: features are played. gyro_wait_s: s of sensor
    time for which the front end then waits for a gyro.
    inputs: {topic: class of its messages, or None where only a plugin knows it}. played: topics to be played. end: time
    at which that part ends, after duration (s). goal: header stamp of the last features (or left image), or None; without frames nothing says
    that the node is done: it may hold the last samples back for what could be late. advice: what to start it with instead, or empty.
    """

    def __init__(self, path, node, start, duration, transport=None, gyro_wait_s=0.0):
        self.path = path
        self.frames = [rospy.resolve_name("features")] if transport is None else [
            rospy.resolve_name(name) + ("" if transport == "raw" else "/" + transport) for name in IMAGES]
        self.is_from_images = transport is not None
        self.inputs = {rospy.resolve_name(name): kind for name, kind in INPUTS.items()}
        self.inputs.update({TRANSFORMS: TFMessage, STATIC_TOPIC: TFMessage})
        if self.is_from_images:
            del self.inputs[rospy.resolve_name("features")]  # an earlier run's
            self.inputs.update({topic: IMAGE_KINDS.get(transport) for topic in self.frames})
        try:
            with rosbag.Bag(path) as bag:
                self._read(bag, node, start, duration, gyro_wait_s)
        except (rosbag.ROSBagException, OSError) as error:
            raise PlayError("%s: cannot be read: %s (cut short? try 'rosbag reindex')" % (path, error)) from error

    def _read(self, bag, node, start, duration, gyro_wait_s):
        recorders = {}  # {topic: names of the nodes that sent it}
        for connection in bag._get_connections():
            recorders.setdefault(connection.topic, set()).add(connection.header.get("callerid", b"").decode(errors="replace"))
        measurements = [rospy.resolve_name(name) for name in MEASUREMENTS] + (self.frames if self.is_from_images else [])
        if not any(topic in recorders for topic in measurements):
            raise PlayError("%s: none of %s is in it; it has %s" %
                            (self.path, ", ".join(measurements), ", ".join(sorted(recorders)) or "nothing"))
        outputs = {rospy.resolve_name(name) for name in NOT_PLAYED}
        if self.is_from_images:
            outputs.add(rospy.resolve_name("features"))
            for topic in self.frames:
                if topic not in recorders:
                    raise PlayError("%s: no %s in it, which the front end needs (left_image, right_image, image_transport); it "
                                    "has %s" % (self.path, topic, ", ".join(sorted(recorders))))
        self.played = sorted(
            topic for topic, callers in recorders.items()
            if topic in self.inputs or not (topic in outputs or topic.startswith(node + "/") or callers == {node}))
        self.advice = "" if self.is_from_images else self._advice(recorders)
        self.unheard = [topic for topic in self.played if topic not in self.inputs]
        self._check_kinds(bag)
        first, last = _span(bag)
        begin = first + start
        if begin > last:
            raise PlayError("~start is %g s; %s has %g s" % (start, self.path, last - first))
        self.end = rospy.Time.from_sec(min(begin + duration, last) if duration else last)
        self.duration = self.end.to_sec() - begin
        if self.is_from_images and rospy.resolve_name("imu") not in recorders and self.duration <= gyro_wait_s:
            raise PlayError("%s: no %s in it, for which the front end waits %g s of sensor time (buffer/max_delay_s) before the "
                            "first pair goes on, and only %.3g s of it are played; run_bag needs not wait"
                            % (self.path, rospy.resolve_name("imu"), gyro_wait_s, self.duration))
        self.goal = self._last_stamp(bag, self.frames[0], begin)
        body = "imu" if rospy.resolve_name("imu") in recorders else "left/camera_info"  # a camera alone
        self.imu_frame = next((message.header.frame_id for _, message, _ in
                               bag.read_messages([rospy.resolve_name(body)])), None)

    def _advice(self, topics):
        """What to start so that the pictures of a bag without features are used; empty: nothing."""
        for ending in ("", "/compressed"):
            images = [rospy.resolve_name(name) + ending for name in IMAGES]
            if self.frames[0] not in topics and all(topic in topics for topic in images):
                return ("%s: no %s in it; front_end:=true%s makes them of %s" %
                        (self.path, self.frames[0], " image_transport:=compressed" if ending else "", " and ".join(images)))
        return ""

    def _check_kinds(self, bag):
        """The player would wait for ever for a listener to a topic of another type. ROS compares the checksums."""
        for connection in bag._get_connections():
            kind = self.inputs.get(connection.topic)
            if kind is not None and connection.md5sum != kind._md5sum:
                here = " as it is defined here" if connection.datatype == kind._type else ""
                raise PlayError("%s: %s is %s, it must be %s%s"
                                % (self.path, connection.topic, connection.datatype, kind._type, here))

    def _last_stamp(self, bag, topic, begin):
        since = rospy.Time.from_sec(max(begin, self.end.to_sec() - LAST_S))
        return max((message.header.stamp for _, message, _ in bag.read_messages([topic], since, self.end)), default=None)


def _span(bag):
    """Times (s) of the first and the last message; rosbag's are those of the first and last chunk, wrong once one appends."""
    if not bag._chunks:
        return bag.get_start_time(), bag.get_end_time()
    return (min(chunk.start_time.to_sec() for chunk in bag._chunks), max(chunk.end_time.to_sec() for chunk in bag._chunks))


def find_bag(path):
    """Absolute path of the bag; a relative one is tried from where roslaunch was started (PWD) too."""
    for folder in (os.getcwd(), os.environ.get("PWD", "")):
        candidate = os.path.join(folder, os.path.expanduser(path))
        if os.path.isfile(candidate):
            return os.path.abspath(candidate)
    raise PlayError("bag %r: no such file" % path)


class OwnTransforms:
    """Those that slam_node sends itself by its parameters, so that a recorded /tf must not bring them too.

    That of the vehicle is one of them whether the earlier run sent it from map or odom, to the base or the IMU.
    node: its name. imu_frame: of the bag's IMU, or its left camera; counts where the parameters name none.
    """

    def __init__(self, node, imu_frame):
        def parameter(name, default):
            return rospy.get_param("%s/ros/%s" % (node, name), default)
        self.map, self.odom = parameter("map_frame", "map"), parameter("odom_frame", "odom")
        imu = parameter("imu_frame", "") or (imu_frame or "").lstrip("/")
        self.bodies = {imu, parameter("base_frame", "") or imu}
        sends = parameter("publish_tf", True)
        self.sends_correction = sends and parameter("publish_map_tf", True)
        self.sends_body = sends and (parameter("publish_odom_tf", True) or parameter("single_tf", False))

    def __contains__(self, transform):
        parent, child = transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
        if child in self.bodies:
            return self.sends_body and parent in (self.map, self.odom)
        return self.sends_correction and (parent, child) == (self.map, self.odom)
