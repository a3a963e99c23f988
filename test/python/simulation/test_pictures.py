"""simulate_dataset.py --images: what is drawn is where geometry says, and the IMU feels the motion that the truth has."""

import cv2
import numpy as np
import pytest
import yaml

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.bag.reader import read_reference
from vi_ekf_slam.common.geometry import inverse, make_transform, so3_exp
from vi_ekf_slam.simulation.pictures.motion import GRAVITY, MOTIONS, felt, velocity
from vi_ekf_slam.simulation.pictures.scene import SCENES, SKY, Rectangle, draw
from vi_ekf_slam.simulation.simulator import main

K = np.array([[200.0, 0, 159.5], [0, 200.0, 119.5], [0, 0, 1.0]])
SIZE = (320, 240)


def flat(corner, along, up, level):
    """A rectangle of one grey level, by its vectors in camera axes."""
    return Rectangle(*(np.array(v, dtype=float) for v in (corner, along, up)), np.full((64, 64), level, np.uint8))


def facing(depth, half, level):
    """A square of 2 x half m that faces the camera."""
    return flat([-half, half, depth], [2 * half, 0, 0], [0, -2 * half, 0], level)


def test_a_square_covers_the_pixels_whose_rays_meet_it():
    image = draw([facing(2.0, 0.5, 90)], np.eye(4), K, SIZE)
    covered = image == 90  # half a metre at 2 m: 50 px to each side of (159.5, 119.5)
    assert covered[70:170, 110:210].all() and covered.sum() == 100 * 100 and (image[~covered] == SKY).all()


@pytest.mark.parametrize("order", [1, -1])
def test_the_nearer_hides_the_farther_in_any_order(order):
    image = draw([facing(2.0, 0.2, 50), facing(4.0, 2.0, 150)][::order], np.eye(4), K, SIZE)
    assert image[119, 159] == 50 and image[119, 159 + 22] == 150
    # Two that cut through each other: each is seen where it is nearer.
    tilted = [flat([-1, 1, 3], [2, 0, 2], [0, -2, 0], 60), flat([-1, 1, 5], [2, 0, -2], [0, -2, 0], 160)]
    image = draw(tilted[::order], np.eye(4), K, SIZE)
    assert image[119, 150] == 60 and image[119, 169] == 160


def test_what_is_behind_or_reaches_behind_the_camera_is_drawn_right():
    floor = flat([-50, 1, -50], [100, 0, 0], [0, 0, 100], 70)
    image = draw([floor, facing(-2.0, 1.0, 30)], np.eye(4), K, SIZE)
    assert (image[:119] == SKY).all() and (image[125:] == 70).all()  # the horizon is at 119.5, 50 m off at 123.5


def test_a_texture_is_where_its_plane_is():
    """A blot on a tilted wall, seen by a camera that has moved: its centre is at the projection of its place."""
    texture = np.full((512, 512), 255, np.uint8)
    cv2.circle(texture, (384, 128), 20, 0, -1)  # its first row is at the far end of `up`: a = 0.75, b = 0.75
    wall = Rectangle(np.array([-1.0, 1.0, 3.0]), np.array([2.0, 0, 0.8]), np.array([0, -2.0, 0.3]), texture)
    cam_T_world = make_transform(so3_exp([0.05, -0.1, 0.2]), [0.1, -0.05, 0.3])
    dark = 255.0 - np.minimum(draw([wall], cam_T_world, K, SIZE), 255.0)
    dark[dark < 60] = 0.0
    v, u = np.mgrid[0:240, 0:320]
    point = cam_T_world @ np.append(wall.frame @ [384.5 / 512, 1.0 - 128.5 / 512, 1.0], 1.0)
    expected = (K @ point[:3] / point[2])[:2]
    assert [np.sum(u * dark) / dark.sum(), np.sum(v * dark) / dark.sum()] == pytest.approx(list(expected), abs=0.3)


@pytest.mark.parametrize("scene", sorted(MOTIONS))
def test_the_imu_feels_the_motion(scene):
    """Integrated without noise it comes to the true pose; at rest it feels gravity alone."""
    motion = MOTIONS[scene](0.5, 20.0)
    assert np.allclose(felt(motion, 1.0)[0], 0.0) and np.linalg.norm(felt(motion, 1.0)[1]) == pytest.approx(9.81)
    step, rotation, p, v = 0.005, motion.pose(1.0)[:3, :3], motion.pose(1.0)[:3, 3], np.zeros(3)
    for k in range(1800):  # 9 s, by the midpoint rule
        rate, force = felt(motion, 1.0 + (k + 0.5) * step)
        acceleration = rotation @ so3_exp(0.5 * step * rate) @ force + GRAVITY
        p, v, rotation = p + step * v + 0.5 * step**2 * acceleration, v + step * acceleration, rotation @ so3_exp(step * rate)
    expected = motion.pose(10.0)
    assert p == pytest.approx(expected[:3, 3], abs=5e-3) and np.allclose(rotation, expected[:3, :3], atol=1e-3)
    assert v == pytest.approx(velocity(motion, 10.0), abs=2e-3)
    assert np.linalg.norm(v) > 0.3


@pytest.mark.parametrize("scene", sorted(MOTIONS))
def test_laps_end_where_they_began(scene):
    motion = MOTIONS[scene](2.0, 30.0)
    assert np.allclose(motion.pose(30.0)[:2, 3], motion.pose(0.0)[:2, 3], atol=1e-6)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A short drive in the room."""
    folder = tmp_path_factory.mktemp("pictures") / "room"
    assert main([str(folder), "--images", "--scene", "room", "--duration", "7", "--laps", "0.4", "--frame-rate", "2",
                 "--quiet"]) == 0
    return folder


def test_the_folder_is_a_drive_that_the_converter_takes(drawn, tmp_path):
    path = str(tmp_path / "room.bag")
    assert convert([str(drawn), path, "--quiet"]) == 0
    reference = read_reference(path)
    assert len(reference.frame_stamps) == 13 and len(reference.truth[0]) == 13
    assert yaml.safe_load((tmp_path / "room.imu.yaml").read_text())["update_rate"] == 200.0
    motion = MOTIONS["room"](0.4, 7.0)
    moved = [inverse(motion.pose(0.0021)) @ motion.pose(0.0021 + 0.5 * k) for k in range(13)]
    first = inverse(reference.truth[1][0])
    assert all(np.allclose(first @ pose, m, atol=1e-4) for pose, m in zip(reference.truth[1], moved))


def test_a_point_seen_in_both_pictures_is_at_the_depth_of_its_wall(drawn):
    """Block matching on the pair, without anything of the renderer: the room's walls are between 1.5 and 5 m away."""
    name = sorted(path.name for path in (drawn / "mav0" / "cam0" / "data").iterdir())[0]
    left, right = (cv2.imread(str(drawn / "mav0" / camera / "data" / name), cv2.IMREAD_GRAYSCALE) for camera in ("cam0", "cam1"))
    disparity = cv2.StereoBM_create(64, 15).compute(left, right) / 16.0
    found = disparity[disparity > 0]
    depths = 400.0 * 0.11 / found
    assert len(found) > 0.5 * disparity.size and 1.5 < np.percentile(depths, 10) and np.percentile(depths, 90) < 5.0
    # The rig begins 2.2 m from the wall that it faces, the camera 0.15 m nearer.
    assert np.median(depths[np.abs(depths - 2.05) < 0.5]) == pytest.approx(2.05, abs=0.05)


def test_the_same_seed_draws_the_same(tmp_path):
    options = ["--images", "--scene", "room", "--duration", "5", "--laps", "0.2", "--frame-rate", "1", "--quiet"]
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        assert main([str(tmp_path / name), "--seed", seed] + options) == 0
    a, b, c = ({str(path.relative_to(tmp_path / name)): path.read_bytes() for path in (tmp_path / name).rglob("*.*")
                if path.is_file()} for name in "abc")
    assert a == b and a.keys() == c.keys() and a != c


def built_once(build):
    """The same scenes of the same random numbers, which leave the generator as they would; most of a short drive's time goes there."""
    kept = {}

    def scene(random):
        before = str(random.bit_generator.state)
        if before not in kept:
            kept[before] = build(random), random.bit_generator.state
        parts, random.bit_generator.state = kept[before]
        return list(parts)
    return scene


def test_blur_cars_and_exposure_change_the_pictures(tmp_path, monkeypatch):
    monkeypatch.setitem(SCENES, "street", built_once(SCENES["street"]))
    pictures = {}
    for name, more in (("plain", []), ("blurred", ["--exposure", "0.05"]), ("cars", ["--cars", "12"]),
                       ("bright", ["--exposure-drift", "0.4"])):
        folder = tmp_path / name
        assert main([str(folder), "--images", "--duration", "6", "--laps", "0.1", "--frame-rate", "1", "--pixel-noise", "0",
                     "--quiet"] + more) == 0
        last = sorted((folder / "mav0" / "cam0" / "data").iterdir())[-1]
        pictures[name] = cv2.imread(str(last), cv2.IMREAD_GRAYSCALE).astype(float)
    sharpness = {name: np.mean(np.abs(np.diff(image, axis=1))) for name, image in pictures.items()}
    assert sharpness["blurred"] < 0.9 * sharpness["plain"]
    assert abs(pictures["bright"].mean() / pictures["plain"].mean() - 1.0) > 0.05
    assert np.mean(np.abs(pictures["cars"] - pictures["plain"]) > 10) > 0.001


@pytest.mark.parametrize("options, complaint", [
    (("--scene", "room", "--cars", "2"), "--cars is 2, allowed with --scene street only"),
    (("--duration", "1"), "--duration is 1, allowed: from 5 to 3600"),
    (("--frame-rate", "0"), "--frame-rate is 0"), (("--exposure", "1"), "--exposure is 1")])
def test_what_cannot_be_drawn_is_refused(tmp_path, capfd, options, complaint):
    assert main([str(tmp_path / "out"), "--images"] + list(options)) == 2
    assert complaint in capfd.readouterr().err and not list(tmp_path.iterdir())


def test_a_folder_that_is_there_is_not_replaced(drawn, capfd):
    assert main([str(drawn), "--images"]) == 2
    assert "is there already" in capfd.readouterr().err


def test_a_folder_that_cannot_be_made_is_refused(capfd):
    assert main(["/proc/drive", "--images", "--duration", "5"]) == 2
    assert capfd.readouterr().err == "error: /proc/drive: cannot be written: No such file or directory\n"
