"""A drive of a vehicle whose IMU has accelerometers, without a velocity: at rest, then ever faster, then along the circle of
drive_data at its speed. The IMU is mounted with a tilt, the base is level and at the same place."""

import math

import numpy as np
import rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

import drive_data
from drive_data import BASE, CAMERA_IN_IMU, IMU, LEFT, SPEED, YAW_RATE

REST, RAMP = 1.0, 2.0  # s
GRAVITY = 9.81         # m/s^2
TILT = 0.3             # rad, of the IMU about the base's x axis
RATE = 400             # Hz, of the IMU
PER_FRAME = 40         # samples
DENSITIES = (2e-4, 2e-3)  # rad/s/sqrt(Hz) and m/s^2/sqrt(Hz), as the messages' covariances say them


def _share(time):
    """Of the ramp that is over."""
    return min(max((time - REST) / RAMP, 0.0), 1.0)


def speed_at(time):
    """m/s"""
    s = _share(time)
    return SPEED * s * s * (3.0 - 2.0 * s)


def circle_time(time):
    """When the drive at constant speed is as far, s."""
    s = _share(time)
    return RAMP * s ** 3 * (1.0 - 0.5 * s) + max(time - REST - RAMP, 0.0)


def pose_at(time):
    """(x, y, yaw) of the base."""
    return drive_data.pose_at(circle_time(time))


def to_imu(vector):
    """Along the IMU's axes."""
    x, y, z = vector
    c, s = math.cos(TILT), math.sin(TILT)
    return x, c * y + s * z, c * z - s * y


def imu(stamp, time):
    """Gyro and accelerometer, exact."""
    message = drive_data.imu(stamp)
    s, speed = _share(time), speed_at(time)
    turn = YAW_RATE * speed / SPEED
    ahead = 6.0 * SPEED / RAMP * s * (1.0 - s)
    for vector, values in ((message.angular_velocity, (0.0, 0.0, turn)),
                           (message.linear_acceleration, (ahead, speed * turn, GRAVITY))):
        vector.x, vector.y, vector.z = to_imu(values)
    gyro, accelerometer = (RATE * density ** 2 for density in DENSITIES)
    message.angular_velocity_covariance = [gyro if i in (0, 4, 8) else 0.0 for i in range(9)]
    message.linear_acceleration_covariance = [accelerometer if i in (0, 4, 8) else 0.0 for i in range(9)]
    return message


def _transform(stamp, parent, child, translation, rotation):
    message = TransformStamped()
    message.header.stamp, message.header.frame_id, message.child_frame_id = stamp, parent, child
    t, r = message.transform.translation, message.transform.rotation
    t.x, t.y, t.z = translation
    r.x, r.y, r.z, r.w = rotation
    return message


def extrinsics(stamp):
    """base_link to the IMU, and the IMU to the left camera, which looks ahead as in drive_data."""
    half = 0.5 * TILT
    level = drive_data.extrinsic(stamp).transforms[0].transform.rotation
    x, y, z, w = level.x, level.y, level.z, level.w
    c, s = math.cos(half), -math.sin(half)  # of the turn back about x, (s, 0, 0, c), times the level rotation
    to_camera = (c * x + s * w, c * y - s * z, c * z + s * y, c * w - s * x)
    return TFMessage([_transform(stamp, BASE, IMU, (0.0, 0.0, 0.0), (math.sin(half), 0.0, 0.0, math.cos(half))),
                      _transform(stamp, IMU, LEFT, to_imu(CAMERA_IN_IMU), to_camera)])


def drive(begin, end, start):
    """[(topic, message)] of the times (s) from begin to end of the drive that began at the stamp `start` (s)."""
    messages = []
    for step in range(int(round(begin * RATE)), int(round(end * RATE)) + 1):
        time = step / RATE
        stamp = rospy.Time.from_sec(start) + rospy.Duration.from_sec(time)
        if not messages:
            messages += [("/tf_static", extrinsics(stamp)), ("left/camera_info", drive_data.camera_info(stamp, False)),
                         ("right/camera_info", drive_data.camera_info(stamp, True))]
        messages.append(("imu", imu(stamp, time)))
        if step % PER_FRAME == 0:
            messages.append(("features", drive_data.features(stamp, circle_time(time))))
    return messages


def state_at(time):
    """{field: numbers} of the IMU in the frame in which pose_at is, as a file of an initial state holds them."""
    x, y, yaw = pose_at(time)
    a, b = 0.5 * yaw, 0.5 * TILT
    orientation = (math.cos(a) * math.sin(b), math.sin(a) * math.sin(b), math.sin(a) * math.cos(b), math.cos(a) * math.cos(b))
    speed = speed_at(time)
    sigma = np.repeat([1e-3, 1e-3, 1e-2, 1e-3, 1e-2], 3)
    return {"position": (x, y, 0.0), "orientation": orientation,
            "velocity": (speed * math.cos(yaw), speed * math.sin(yaw), 0.0), "gyro_bias": (0.0, 0.0, 0.0),
            "accelerometer_bias": (0.0, 0.0, 0.0), "covariance": np.diag(sigma ** 2).ravel().tolist()}
