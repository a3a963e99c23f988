"""Synthetic traffic in a real drive: features on cars ahead that follow the same road at other speeds.

Each car is a rigid box of points that moves along the true path of the drive, a gap ahead of the camera that opens or
closes slowly; so its features are coherent, stay in view for long, and contradict the static world.
"""

import numpy as np

from vi_ekf_slam.common.geometry import inverse, make_transform
from vi_ekf_slam.dataset.degradation import keep_tracks, require_truth

CARS = 4
GAP = (8.0, 30.0)  # m, from our IMU to a car's middle
RELATIVE_SPEED = (-3.0, 3.0)  # m/s, how fast the gap opens; nearly never 0
LANES = (-3.5, 0.0, 0.0, 3.5)  # m to the left of our path
BOX = (4.0, 1.8, 1.4)  # m, length, width, height
CENTRE_HEIGHT = -0.2  # m, of the box above our IMU's path
PIXEL_NOISE = 0.5  # px
MEAN_LIFE = 15.0  # frames of a track
MIN_DEPTH = 3.0  # m


class _Road:
    """The true path of the IMU by arc length, prolonged straight on at its end."""

    def __init__(self, poses):
        steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
        self.station = np.concatenate([[0.0], np.cumsum(steps)])
        self.poses = poses

    def pose(self, station):
        """World pose of a car at `station` m along the path."""
        k = int(np.clip(np.searchsorted(self.station, station, side="right") - 1, 0, len(self.poses) - 1))
        ahead = make_transform(np.eye(3), [station - self.station[k], 0.0, 0.0])
        return self.poses[k] @ ahead


class _Car:
    def __init__(self, random):
        self.gap = random.uniform(*GAP)
        self.speed = random.uniform(*RELATIVE_SPEED)
        self.lane = random.choice(LANES)


def add_traffic(dataset, frames, truth, share, seed):
    """Frames in which `share` (0..1) of the features ride on cars.

    Of the real tracks every other one stays, as behind cars; cars' features come on top until the share is reached,
    frame by frame (a frame without real features gets none). truth: (stamps, poses) of the IMU at every frame.
    Returns (frames, number of features on cars).
    """
    stamps, poses = truth
    require_truth(dataset, stamps)
    frames = keep_tracks(frames, 2)
    random, road = np.random.default_rng(seed), _Road(poses)
    next_id = 1 + max([int(ids.max()) for ids, _ in frames if len(ids)] + [0])
    cars, tracks, result, total = [_Car(random) for _ in range(CARS)], [], [], 0
    for k, (ids, pixels) in enumerate(frames):
        dt = stamps[k] - stamps[k - 1] if k else 0.0
        for i, car in enumerate(cars):
            car.gap += dt * car.speed
            if not GAP[0] - 2.0 <= car.gap <= GAP[1] + 5.0:
                tracks = [track for track in tracks if track[1] is not car]
                cars[i] = _Car(random)
        wanted = int(round(len(ids) * share / (1.0 - share)))
        cam_T_world = dataset.cam_T_imu @ inverse(poses[k])
        cam_T_car = {id(car): cam_T_world @ road.pose(road.station[k] + car.gap) @
                     make_transform(np.eye(3), [0.0, car.lane, CENTRE_HEIGHT]) for car in cars}
        visible = [(track, _project(dataset, cam_T_car[id(track[1])], track[2])) for track in tracks if track[3] >= k]
        visible = [(track, where) for track, where in visible if where is not None][:wanted]
        for _ in range(20 * wanted):  # some of the points drawn are out of view
            if len(visible) >= wanted:
                break
            car = cars[random.integers(CARS)]
            point = random.uniform(-0.5, 0.5, 3) * BOX
            where = _project(dataset, cam_T_car[id(car)], point)
            if where is not None:
                visible.append(((next_id, car, point, k + int(random.exponential(MEAN_LIFE))), where))
                next_id += 1
        tracks = [track for track, _ in visible]
        total += len(tracks)
        columns = np.array([where for _, where in visible]).reshape(-1, 4).T
        moving = columns + PIXEL_NOISE * random.normal(size=(4, len(tracks)))
        result.append((np.concatenate([ids, np.array([track[0] for track in tracks], dtype=np.int64)]),
                       np.hstack([pixels, moving])))
    return result, total


def _project(dataset, cam_T_car, point):
    """Pixels (4,) of a car's point, or None outside the images (taken as symmetric about the principal point)."""
    x, y, z = cam_T_car[:3, :3] @ point + cam_T_car[:3, 3]
    if z < MIN_DEPTH:
        return None
    (fu, _, cu), (_, fv, cv) = dataset.intrinsics[:2]
    left, row, right = cu + fu * x / z, cv + fv * y / z, cu + fu * (x - dataset.baseline) / z
    if not (0.0 < right and left < 2.0 * cu and 0.0 < row < 2.0 * cv):
        return None
    return left, row, right, row
