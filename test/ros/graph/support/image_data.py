"""A drive whose bag holds images: a stereo pair that moves along a slanted wall with a random texture."""

import math

import numpy as np
import rospy
from scipy.ndimage import gaussian_filter, map_coordinates
from sensor_msgs.msg import Image

import drive_data

WIDTH, HEIGHT = 320, 240  # px
FX, BASELINE = 260.0, 0.2  # px, m
SPEED, YAW_RATE = 0.5, 0.15  # m/s ahead, rad/s
FRAME_RATE, GYRO_PER_FRAME = 10, 10  # Hz, samples
START = 1000.0  # s
TEXELS_PER_M = 60.0


def texture(seed=3):
    """Grey levels of the wall, (1200, 2400)."""
    noise = gaussian_filter(np.random.RandomState(seed).rand(1200, 2400), 1.5)
    noise -= noise.min()
    return 20.0 + 215.0 * noise / noise.max()


def picture(wall, time, right):
    """(HEIGHT, WIDTH) uint8. The wall is the plane ahead + 0.3 left = 7 m of the frame where the IMU begins."""
    yaw = YAW_RATE * time
    position = np.array([SPEED / YAW_RATE * math.sin(yaw), SPEED / YAW_RATE * (1.0 - math.cos(yaw)), 0.0])
    ahead, left = np.array([math.cos(yaw), math.sin(yaw), 0.0]), np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    position -= BASELINE * left if right else 0.0
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    ray = ahead - ((u - 0.5 * WIDTH) / FX)[..., None] * left - ((v - 0.5 * HEIGHT) / FX)[..., None] * np.array([0.0, 0.0, 1.0])
    normal = np.array([1.0, 0.3, 0.0])
    point = position + ((7.0 - normal @ position) / (ray @ normal))[..., None] * ray
    rows, columns = 600.0 - TEXELS_PER_M * point[..., 2], 1200.0 - TEXELS_PER_M * point[..., 1]
    return np.rint(map_coordinates(wall, [rows, columns], order=3, mode="reflect")).clip(0, 255).astype(np.uint8)


def image(stamp, pixels, frame):
    """As a camera's driver sends it."""
    message = Image(height=HEIGHT, width=WIDTH, encoding="mono8", step=WIDTH, data=pixels.tobytes())
    message.header.stamp, message.header.frame_id = stamp, frame
    return message


def camera_info(stamp, right):
    """Of one of the rectified cameras."""
    message = drive_data.camera_info(stamp, right)
    message.width, message.height, message.distortion_model, message.D = WIDTH, HEIGHT, "plumb_bob", [0.0] * 5
    message.K = [FX, 0, 0.5 * WIDTH, 0, FX, 0.5 * HEIGHT, 0, 0, 1]
    message.P = [FX, 0, 0.5 * WIDTH, -FX * BASELINE if right else 0, 0, FX, 0.5 * HEIGHT, 0, 0, 0, 1, 0]
    return message


def drive(duration=3.0):
    """[(topic, message)] in the order of stamps; the camera sits in the IMU."""
    wall, messages = texture(), []
    for step in range(int(round(duration * FRAME_RATE * GYRO_PER_FRAME)) + 3):
        time = step / float(FRAME_RATE * GYRO_PER_FRAME)
        stamp = rospy.Time.from_sec(START) + rospy.Duration.from_sec(time)
        if step == 0:
            transform = drive_data.extrinsic(stamp)
            moved = transform.transforms[0].transform.translation
            moved.x = moved.y = moved.z = 0.0
            messages += [("/tf_static", transform), ("left/camera_info", camera_info(stamp, False)),
                         ("right/camera_info", camera_info(stamp, True))]
        gyro = drive_data.imu(stamp)
        gyro.angular_velocity.z = YAW_RATE
        messages.append(("imu", gyro))
        if step % GYRO_PER_FRAME:
            continue
        speed = drive_data.velocity(stamp)
        speed.twist.twist.linear.x = SPEED
        messages += [("velocity", speed), ("left/image", image(stamp, picture(wall, time, False), drive_data.LEFT)),
                     ("right/image", image(stamp, picture(wall, time, True), drive_data.RIGHT))]
    return messages
