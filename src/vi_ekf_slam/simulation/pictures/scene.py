"""Scenes of textured rectangles, and their pictures by one perspective warp a rectangle and a depth buffer."""

import cv2
import numpy as np

from vi_ekf_slam.common.geometry import make_transform, so3_exp
from vi_ekf_slam.simulation.pictures import textures
from vi_ekf_slam.simulation.pictures.motion import RoomMotion, StreetMotion

NEAR = 0.05  # m; nothing nearer is drawn
SKY = 205.0  # grey level
LEVELS = 6  # of each texture's pyramid
STREET_HALF_WIDTH, TILE = 8.0, 6.0  # m


class Rectangle:
    """corner (3,), along and up (3,): its sides as vectors, m; texture (n, n) uint8, whose first row is at the far end of up."""

    def __init__(self, corner, along, up, texture):
        self.frame = np.column_stack([along, up, corner])  # world = frame (a, b, 1), 0 <= a, b <= 1
        self.corners = np.array([self.frame @ [a, b, 1.0] for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))])
        self.pyramid = [texture[::-1].astype(np.float32)]
        while len(self.pyramid) < LEVELS:
            self.pyramid.append(cv2.resize(self.pyramid[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))

    def moved(self, transform):
        """The same, carried by world_T_local (4 x 4)."""
        other = Rectangle.__new__(Rectangle)
        other.frame = transform[:3, :3] @ self.frame + np.column_stack([np.zeros((3, 2)), transform[:3, 3]])
        other.corners = self.corners @ transform[:3, :3].T + transform[:3, 3]
        other.pyramid = self.pyramid
        return other


def draw(rectangles, cam_T_world, intrinsics, size):
    """The picture (height, width) float32 of a pinhole camera without distortion. intrinsics 3 x 3, size (width, height)."""
    width, height = size
    image = np.full((height, width), SKY, dtype=np.float32)
    nearest = np.zeros((height, width), dtype=np.float32)  # 1 / depth
    corners = np.array([rectangle.corners for rectangle in rectangles]).reshape(-1, 4, 3) @ cam_T_world[:3, :3].T + cam_T_world[:3, 3]
    for k, (left, top, right, bottom), closest in _in_reach(corners, intrinsics, size):
        drawn = nearest[top:bottom, left:right]
        if closest <= drawn.min():  # behind what is drawn already
            continue
        rectangle = rectangles[k]
        frame = cam_T_world[:3, :3] @ rectangle.frame
        frame[:, 2] += cam_T_world[:3, 3]
        plane = intrinsics @ frame
        if abs(np.linalg.det(plane)) < 1e-9:  # seen edge on
            continue
        # (a, b, 1) / depth = inv(plane) (u, v, 1): all three are linear in the pixel.
        rows = np.linalg.inv(plane)
        u, v = np.arange(left, right, dtype=np.float64), np.arange(top, bottom, dtype=np.float64)[:, None]
        a, b, w = (row[0] * u + (row[1] * v + row[2]) for row in rows)
        where = w > drawn
        for more in (a >= 0, b >= 0, a <= w, b <= w, w < 1.0 / NEAR):
            where &= more
        if not where.any():
            continue
        texture = rectangle.pyramid[_level(rectangle, a, b, w, where)]
        side = texture.shape[0]
        # Texture pixel centres: a = (x + 0.5) / side.
        texel = plane @ np.array([[1.0 / side, 0, 0.5 / side], [0, 1.0 / side, 0.5 / side], [0, 0, 1.0]])
        shift = np.array([[1.0, 0, -left], [0, 1.0, -top], [0, 0, 1.0]])
        warped = cv2.warpPerspective(texture, shift @ texel, (right - left, bottom - top), flags=cv2.INTER_LINEAR,
                                     borderMode=cv2.BORDER_REPLICATE)
        np.copyto(image[top:bottom, left:right], warped, where=where)
        np.copyto(drawn, w, casting="same_kind", where=where)
    return image


def _in_reach(corners, intrinsics, size):
    """Of the rectangles (N, 4, 3) in the camera's frame those that can be in the picture, in their order: index, pixel bounds
    (left, top, right, bottom), and the largest 1 / depth."""
    before = corners[:, :, 2] > NEAR
    whole = before.all(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = corners @ intrinsics.T
        pixels = pixels[:, :, :2] / pixels[:, :, 2:]
        boxes = np.concatenate([np.maximum(np.floor(pixels.min(axis=1)), 0), np.minimum(np.ceil(pixels.max(axis=1)) + 1, size)], axis=1)
    found = [(k, tuple(boxes[k].astype(int)), 1.0 / corners[k, :, 2].min())
             for k in np.flatnonzero(whole & (boxes[:, :2] < boxes[:, 2:]).all(axis=1))]
    for k in np.flatnonzero(before.any(axis=1) & ~whole):
        box = _box(corners[k], intrinsics, size)
        if box is not None:
            found.append((k, box, 1.0 / NEAR))
    return sorted(found)


def _box(corners, intrinsics, size):
    """Pixel bounds (left, top, right, bottom) of a rectangle's part before the camera; None where nothing is in the picture."""
    clipped = []
    for first, second in zip(corners, corners[[1, 2, 3, 0]]):
        if first[2] > NEAR:
            clipped.append(first)
        if (first[2] > NEAR) != (second[2] > NEAR):
            clipped.append(first + (NEAR - first[2]) / (second[2] - first[2]) * (second - first))
    if not clipped:
        return None
    pixels = np.array(clipped) @ intrinsics.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    low = [max(int(np.floor(v)), 0) for v in pixels.min(axis=0)]
    high = [min(int(np.ceil(v)) + 1, most) for v, most in zip(pixels.max(axis=0), size)]
    return (*low, *high) if low[0] < high[0] and low[1] < high[1] else None


def _level(rectangle, a, b, w, where):
    """The pyramid's level with about one texture pixel a pixel, where most of the rectangle is seen."""
    w = w[where]
    share = np.ptp(a[where] / w) * np.ptp(b[where] / w)  # of the texture that is in view
    texels = max(share, 1e-9) * rectangle.pyramid[0].size
    return min(int(0.5 * np.log2(max(texels / len(w), 1.0)) + 0.5), LEVELS - 1)


def box(corner, sides, random):
    """The five visible faces of a box with sides along the axes (m), from its lowest corner."""
    (x, y, z), (l, w, h) = corner, sides
    faces = [((x, y, z), (l, 0, 0), (0, 0, h)), ((x + l, y + w, z), (-l, 0, 0), (0, 0, h)),
             ((x, y + w, z), (0, -w, 0), (0, 0, h)), ((x + l, y, z), (0, w, 0), (0, 0, h)),
             ((x, y, z + h), (l, 0, 0), (0, w, 0))]
    return [Rectangle(*(np.array(v, dtype=float) for v in face), textures.wall(random)) for face in faces]


def street(random):
    """Houses on both sides of the ellipse that StreetMotion drives, the road, and parked cars."""
    a, b = StreetMotion.AXES
    parts = []
    for offset in (-STREET_HALF_WIDTH, STREET_HALF_WIDTH):
        count = int(round(np.pi * (a + b + 2 * offset) / TILE))
        angles = 2.0 * np.pi * np.arange(count + 1) / count
        radii = offset + random.uniform(0.0, 1.5, count) * np.sign(offset)
        for first, second, setback in zip(angles[:-1], angles[1:], radii):
            ends = [np.array([(a + setback) * np.cos(t), (b + setback) * np.sin(t), 0.0]) for t in (first, second)]
            up = np.array([0.0, 0.0, random.uniform(5.0, 10.0)])
            parts.append(Rectangle(ends[0], ends[1] - ends[0], up, textures.wall(random)))
            if random.random() < 0.5:  # a parked car or a bin before it
                middle = 0.5 * (ends[0] + ends[1]) * (1.0 - np.sign(offset) * random.uniform(1.5, 2.5) / (0.5 * (a + b)))
                parts += box(middle, random.uniform([0.8, 0.8, 0.8], [2.0, 1.5, 1.6]), random)
    reach = STREET_HALF_WIDTH + 2.0
    for x in np.arange(-a - reach, a + reach, TILE):
        for y in np.arange(-b - reach, b + reach, TILE):
            centre = np.hypot((x + TILE / 2) / a, (y + TILE / 2) / b)
            if abs(centre - 1.0) * min(a, b) < reach + TILE:
                parts.append(Rectangle(np.array([x, y, 0.0]), np.array([TILE, 0, 0]), np.array([0, TILE, 0]),
                                       textures.ground(random)))
    return parts


def room(random):
    """Four walls, floor, ceiling and furniture about RoomMotion's path."""
    half, height, parts = np.array([RoomMotion.AXES[0] + 2.2, RoomMotion.AXES[1] + 2.2]), 3.0, []
    ends = [np.array([sx * half[0], sy * half[1], 0.0]) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    for first, second in zip(ends, ends[1:] + ends[:1]):
        for k in range(3):
            parts.append(Rectangle(first + k / 3.0 * (second - first), (second - first) / 3.0, np.array([0, 0, height]),
                                   textures.wall(random)))
    for z in (0.0, height):
        for x in (-1, 0):
            for y in (-1, 0):
                parts.append(Rectangle(np.array([x * half[0], y * half[1], z]), np.array([half[0], 0, 0]),
                                       np.array([0, half[1], 0]), textures.ground(random)))
    for angle in 2.0 * np.pi * (np.arange(8) + random.uniform(0.0, 0.5, 8)) / 8:
        place = np.array([(half[0] - 0.7) * np.cos(angle), (half[1] - 0.7) * np.sin(angle), 0.0])
        parts += box(place - [0.3, 0.3, 0.0], random.uniform([0.3, 0.3, 0.5], [0.6, 0.6, 1.7]), random)
    return parts


SCENES = {"street": street, "room": room}


class Car:
    """Another car, which drives the street at `speed` rad/s of the ellipse from `start` rad on, `aside` m to the left."""

    def __init__(self, start, speed, aside, random):
        self._start, self._speed, self._aside = start, speed, aside
        self._faces = box((-2.1, -0.9, 0.2), (4.2, 1.8, 1.4), random)

    def at(self, t):
        """Its rectangles at t s."""
        a, b = StreetMotion.AXES
        angle = self._start + self._speed * t
        rotation = so3_exp([0, 0, np.arctan2(b * np.cos(angle), -a * np.sin(angle))])
        position = np.array([a * np.cos(angle), b * np.sin(angle), 0.0]) + self._aside * rotation[:, 1]
        return [face.moved(make_transform(rotation, position)) for face in self._faces]
