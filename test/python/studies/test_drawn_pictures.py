"""Two laps of a drawn street: the trajectory of our front end's tracks beside that of perfect ones (the same features, with the pixels of
the points that they begin at), and the loop that both must close. VI_EKF_SLAM_PICTURE_SEEDS=1,2,3 draws more streets than one."""

import os

import numpy as np
import rosbag

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.common.geometry import inverse
from vi_ekf_slam.evaluation.run_io import read_summary
from vi_ekf_slam.simulation.pictures.drive import BASELINES, START, make_parser, write_drive
from vi_ekf_slam.simulation.pictures.lens import Pinhole

SEEDS = [int(seed) for seed in os.environ.get("VI_EKF_SLAM_PICTURE_SEEDS", "1").split(",")]
MOST_RATIO = 1.5  # what is demanded, of many streets; 1.38 and 1.45 in the mean of eight
# A single street scatters, on those eight from 1.0 to 1.9: the ATE of one moves
# by a third with rounding.
MOST_OF_ONE = 2.5
MANY = 5
CENTRE, FOCAL_LENGTH = 0.5 * (np.array(Pinhole.size) - 1), Pinhole.focal_length


def distances(rectangles, origin, rays):
    """(N,) of the nearest rectangle along each of rays (N, 3) from origin, in their lengths; inf: none."""
    frames = np.array([rectangle.frame for rectangle in rectangles]) - np.outer(origin, [0, 0, 1.0])
    frames = frames[np.abs(np.linalg.det(frames)) >= 1e-9]
    a, b, w = np.moveaxis(np.linalg.solve(frames, rays.T[None]), 1, 0)
    hit = (w > 0) & (a >= 0) & (b >= 0) & (a <= w) & (b <= w)
    with np.errstate(divide="ignore"):
        return 1.0 / np.max(w, axis=0, where=hit, initial=0.0)  # of its inverse


def make_perfect(tracks, perfect, scene, motion, imu_T_left):
    """The bag `perfect`: that of `tracks` with each feature where the point is that its track began at."""
    points = {}
    with rosbag.Bag(tracks) as source, rosbag.Bag(perfect, "w") as target:
        for topic, message, stamp in source.read_messages():
            if topic == "/features":
                pose = motion.pose((message.header.stamp.to_nsec() - START) * 1e-9) @ imu_T_left
                _begin(points, [f for f in message.features if f.id not in points], scene, pose)
                message.features = [f for f in message.features if _move(f, inverse(pose), points[f.id])]
            target.write(topic, message, stamp)


def _begin(points, features, scene, world_T_left):
    if not features:
        return
    pixels = np.array([[f.u_left, f.v_left] for f in features])
    rays = np.column_stack([(pixels - CENTRE) / FOCAL_LENGTH, np.ones(len(pixels))]) @ world_T_left[:3, :3].T
    origin = world_T_left[:3, 3]
    for feature, ray, distance in zip(features, rays, distances(scene, origin, rays)):
        points[feature.id] = origin + distance * ray


def _move(feature, left_T_world, point):
    """Whether the point is seen at all, and the feature put where it is."""
    if not np.isfinite(point).all():
        return False
    x, y, z = left_T_world[:3, :3] @ point + left_T_world[:3, 3]
    if z < 0.1:
        return False
    feature.u_left, feature.u_right = (CENTRE[0] + FOCAL_LENGTH * (x - shift) / z for shift in (0.0, BASELINES["street"]))
    feature.v_left = feature.v_right = CENTRE[1] + FOCAL_LENGTH * y / z
    feature.walk = 0.0
    return True


def test_tracks_of_pictures_are_nearly_as_good_as_perfect_ones(evaluated, tmp_path):
    ratios = []
    for seed in SEEDS:
        folder = tmp_path / ("street%d" % seed)
        folder.mkdir()
        world = write_drive(str(folder), make_parser().parse_args([str(folder), "--seed", str(seed), "--quiet"]))
        pictures, tracks, perfect = (str(tmp_path / ("%s%d.bag" % (name, seed))) for name in ("pictures", "tracks", "perfect"))
        assert convert([str(folder), pictures, "--quiet"]) == 0

        def judged(bag, run, *options):
            data = evaluated(bag, run, *options, truth=("--bag", pictures))
            return (data["slam"]["ate_yaw_aligned_m"], data["smoothed"]["ate_yaw_aligned_m"], data["consistency"]["pose_nees"],
                    read_summary(os.path.join(run, "summary.yaml"))["places_recognised"])

        ours = judged(pictures, str(tmp_path / ("ours%d" % seed)), "--save-features", tracks)
        make_perfect(tracks, perfect, *world)
        best = judged(perfect, str(tmp_path / ("best%d" % seed)))
        print("seed %d: ATE, smoothed, NEES, places: ours %.3f m %.3f m %.1f %d, perfect tracks %.3f m %.3f m %.1f %d"
              % (seed, *ours, *best))
        assert ours[3] > 0 and best[3] > 0, "the second lap is not recognised"
        assert ours[1] < ours[0], "the loop that is closed makes the path worse"
        ratios.append(ours[0] / best[0])
    print("ATE over that of perfect tracks: %s, mean %.2f" % (" ".join("%.2f" % r for r in ratios), np.mean(ratios)))
    assert max(ratios) <= MOST_OF_ONE
    assert len(ratios) < MANY or np.mean(ratios) <= MOST_RATIO
