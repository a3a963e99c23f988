"""A short drive with exact geometry, as messages: the input of the node's tests."""

import functools
import math

import numpy as np
import rosbag
import rospy
from geometry_msgs.msg import TransformStamped, TwistWithCovarianceStamped
from roslib.packages import find_node
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Imu
from tf2_msgs.msg import TFMessage

from vi_ekf_slam.msg import StereoFeature, StereoFeatureArray

SPEED = 2.0        # m/s, along the body's x axis
YAW_RATE = 0.2     # rad/s
SPEED_ERROR = 0.1  # m/s that the measured speed is wrong by, so that a correction can be told from a prediction
FX, CX, CY, BASELINE = 500.0, 320.0, 240.0, 0.5
CAMERA_IN_IMU = (0.4, 0.2, 0.1)  # m; the camera looks along x
IMU_IN_BASE = (0.3, -0.2, 0.9)  # m; the IMU's x axis is the base's y axis
BASE = "base_link"
IMU, LEFT, RIGHT = "imu_link", "left_camera_optical", "right_camera_optical"


def program(name):
    """Path of a program of the package in the workspace that is sourced."""
    return program_of("vi_ekf_slam", name)


@functools.lru_cache(maxsize=None)  # looks through all folders of the package
def program_of(package, name):
    """Path of a program of any package."""
    return find_node(package, name)[0]  # unlike rosrun it does look below the package's own build folder


def _header(message, stamp, frame):
    message.header.stamp = stamp
    message.header.frame_id = frame
    return message


def pose_at(time):
    """(x, y, yaw) of the circle that the body follows."""
    yaw = YAW_RATE * time
    radius = SPEED / YAW_RATE
    return radius * math.sin(yaw), radius * (1.0 - math.cos(yaw)), yaw


def imu(stamp):
    """Gyro sample."""
    message = _header(Imu(), stamp, IMU)
    message.angular_velocity.z = YAW_RATE
    message.angular_velocity_covariance = [1e-6 if i in (0, 4, 8) else 0.0 for i in range(9)]
    return message


def velocity(stamp):
    """Velocity with a systematic error."""
    message = _header(TwistWithCovarianceStamped(), stamp, IMU)
    message.twist.twist.linear.x = SPEED + SPEED_ERROR
    message.twist.covariance = [1e-2 if i in (0, 7, 14) else 0.0 for i in range(36)]
    return message


def _landmarks():
    """Points on a grid around the circle."""
    return [(6.0 * i - 24.0, 6.0 * j - 15.0, 1.5 * ((i + j) % 3) - 1.0) for i in range(10) for j in range(10)]


def features(stamp, time, offset=(0.0, 0.0)):
    """What the pair sees `time` s after the start, from `offset` (m, map axes) beside the circle."""
    message = _header(StereoFeatureArray(), stamp, LEFT)
    x, y, yaw = pose_at(time)
    x, y = x + offset[0], y + offset[1]
    for track, (lx, ly, lz) in enumerate(_landmarks()):
        ahead = math.cos(yaw) * (lx - x) + math.sin(yaw) * (ly - y) - CAMERA_IN_IMU[0]
        left = -math.sin(yaw) * (lx - x) + math.cos(yaw) * (ly - y) - CAMERA_IN_IMU[1]
        up = lz - CAMERA_IN_IMU[2]
        if ahead < 2.0 or abs(left) > 0.6 * ahead:
            continue
        u, v = CX - FX * left / ahead, CY - FX * up / ahead
        message.features.append(StereoFeature(track, u, v, u - FX * BASELINE / ahead, v, 0.0, 0.0, b""))
    return message


def camera_info(stamp, right):
    """One camera of the rectified pair."""
    message = _header(CameraInfo(), stamp, RIGHT if right else LEFT)
    message.width, message.height = 640, 480
    message.K = [FX, 0, CX, 0, FX, CY, 0, 0, 1]
    message.R = [1, 0, 0, 0, 1, 0, 0, 0, 1]
    message.P = [FX, 0, CX, -FX * BASELINE if right else 0, 0, FX, CY, 0, 0, 0, 1, 0]
    return message


def base_of(x, y, yaw):
    """(x, y, z, yaw) of the base in the frame where it began, for a pose of the IMU where that began."""
    ahead, left = -IMU_IN_BASE[1], IMU_IN_BASE[0]  # where the base's origin is, along the IMU's axes
    turned, aside = math.cos(yaw) - 1.0, math.sin(yaw)
    x, y = x + ahead * turned - left * aside, y + ahead * aside + left * turned
    return -y, x, 0.0, yaw


def base_extrinsic(stamp):
    """Static transform from the base to the IMU."""
    message = _header(TransformStamped(), stamp, BASE)
    message.child_frame_id = IMU
    translation, rotation = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z = IMU_IN_BASE
    rotation.z = rotation.w = math.sqrt(0.5)
    return message


def base_velocity(stamp, frame=BASE):
    """The velocity of the base's origin along its axes: the IMU's (ahead, 0), and what the turn adds."""
    message = _header(velocity(stamp), stamp, frame)
    linear = message.twist.twist.linear
    ahead = linear.x
    linear.x, linear.y = YAW_RATE * IMU_IN_BASE[1], ahead - YAW_RATE * IMU_IN_BASE[0]
    return message


def wheel_odometry(stamp):
    """The same as wheel odometry says it; its pose is its own."""
    message = _header(Odometry(), stamp, "odom")
    message.child_frame_id = BASE
    message.pose.pose.orientation.w = 1.0
    message.twist = base_velocity(stamp).twist
    return message


def extrinsic(stamp):
    """Static transform from the IMU to the left camera's optical frame (x right, y down, z forward)."""
    message = _header(TransformStamped(), stamp, IMU)
    message.child_frame_id = LEFT
    translation, rotation = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z = CAMERA_IN_IMU
    rotation.x, rotation.y, rotation.z, rotation.w = -0.5, 0.5, -0.5, 0.5
    return TFMessage([message])


def drive(duration=6.0, start=1000.0, gyro_per_frame=1, calibrated=True):
    """[(topic, message)] in the order of stamps; frames and velocity at 10 Hz."""
    messages = []
    steps = int(round(duration * 10 * gyro_per_frame))
    for step in range(steps + 1):
        time = step / (10.0 * gyro_per_frame)
        stamp = rospy.Time.from_sec(start) + rospy.Duration.from_sec(time)
        if step == 0 and calibrated:
            messages.append(("/tf_static", extrinsic(stamp)))
        messages.append(("imu", imu(stamp)))
        if step % gyro_per_frame:
            continue
        messages.append(("velocity", velocity(stamp)))
        if calibrated:
            messages += [("left/camera_info", camera_info(stamp, False)), ("right/camera_info", camera_info(stamp, True))]
        messages.append(("features", features(stamp, time)))
    return messages


def matrix(translation, rotation):
    """4x4 of a translation and a quaternion message."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    m = np.eye(4)
    m[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                 [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                 [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    m[:3, 3] = translation.x, translation.y, translation.z
    return m


def stamp_of(message):
    """Its header's stamp."""
    return (message.transforms[0] if hasattr(message, "transforms") else message).header.stamp


def write_bag(path, messages, latched=False):
    """Writes the drive, plus a topic that no node listens to. latched: whether /tf_static is, as a robot records it."""
    with rosbag.Bag(path, "w") as bag:
        for topic, message in messages:
            header = None
            if latched and topic == "/tf_static":
                header = {"topic": topic, "type": message._type, "md5sum": message._md5sum, "latching": "1",
                          "message_definition": message._full_text}
            bag.write("/" + topic.lstrip("/"), message, stamp_of(message), connection_header=header)
            if topic == "velocity":
                bag.write("/ground_truth/velocity", message, stamp_of(message))
