"""What a picture of rviz must show: where its camera maps points to, and which colours are found there."""

import numpy as np
import rosbag
from PIL import Image

from vi_ekf_slam.common.geometry import quaternion_to_rotation

CAMERA_LIFT = 0.2  # of the distance: rviz's third-person view lifts its camera so that the target is below the middle
FIELD_OF_VIEW = np.pi / 4  # vertical, rviz's default
COLOUR_TOLERANCE = 40


class Scene:
    """The last state in a bag of outputs: path (N, 3), landmarks (L, 3), both m, position (3,) and yaw of the car."""

    def __init__(self, bag, path="/path", landmarks="/landmarks", odometry="/odometry"):
        last = {}
        with rosbag.Bag(bag) as source:
            for topic, message, _ in source.read_messages([path, landmarks, odometry]):
                last[topic] = message
        self.path = _points(p.pose.position for p in last[path].poses)
        self.landmarks = np.vstack([_points(marker.points) for marker in last[landmarks].markers])
        pose = last[odometry].pose.pose
        self.car = _points([pose.position])[0]
        q = pose.orientation
        rotation = quaternion_to_rotation([q.x, q.y, q.z, q.w])
        self.yaw = np.arctan2(rotation[1, 0], rotation[0, 0])

    def project(self, points, view, size):
        """Pixels (M, 2) of points (N, 3) that the configuration's follow view shows, and which of the N those are."""
        width, height = size
        focal = np.array([view["Focal Point"][axis] for axis in "XYZ"], dtype=float)
        yaw, pitch, distance = (float(view[key]) for key in ("Yaw", "Pitch", "Distance"))
        back = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        forward = -turn @ back
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        camera = self.car + turn @ (focal + distance * back) + CAMERA_LIFT * distance * up
        ray = points - camera
        depth = ray @ forward
        scale = 0.5 * height / np.tan(0.5 * FIELD_OF_VIEW)
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = 0.5 * width + scale * (ray @ right) / depth, 0.5 * height - scale * (ray @ up) / depth
        shown = (depth > 1.0) & (u > 5) & (u < width - 6) & (v > 5) & (v < height - 6)
        return np.column_stack([u, v])[shown], shown


def _points(positions):
    return np.array([[p.x, p.y, p.z] for p in positions]).reshape(-1, 3)


def read_picture(path):
    """(height, width, 3) integers."""
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")).astype(int)


def has_colour(picture, colour):
    """Mask (height, width) of the pixels that are close to the colour."""
    return np.abs(picture - np.array(colour)).max(axis=2) < COLOUR_TOLERANCE


def is_between_green_and_red(picture):
    """Mask of the colours from green to red, dark or bright: hardly any blue."""
    red, green, blue = np.moveaxis(picture, 2, 0)
    return (red + green > 100) & (blue < 0.2 * (red + green))


def near(mask, radius):
    """Mask of the pixels within `radius` pixels (in a square) of one in the mask."""
    result = np.zeros_like(mask)
    padded = np.pad(mask, radius)
    for dy in range(2 * radius + 1):
        for dx in range(2 * radius + 1):
            result |= padded[dy:dy + mask.shape[0], dx:dx + mask.shape[1]]
    return result


def share_hit(mask, pixels, radius=2):
    """Share of the pixels (N, 2) around which the mask is set."""
    u, v = np.rint(pixels).astype(int).T
    return near(mask, radius)[v, u].mean()
