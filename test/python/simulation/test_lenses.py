"""simulate_dataset.py --lens: what a lens draws is where OpenCV's model of it projects it, on every side of the cube."""

import cv2
import numpy as np
import pytest
import yaml

from vi_ekf_slam.simulation.pictures.lens import Fisheye, Pinhole, Radtan
from vi_ekf_slam.simulation.pictures.scene import SKY, Rectangle
from vi_ekf_slam.simulation.simulator import main

HALF = 0.06  # m, of the squares, at 1 m


def square(direction):
    """A black square that faces the camera 1 m away."""
    ahead = direction / np.linalg.norm(direction)
    across = np.cross([0.3, 1.0, 0.2], ahead)
    across /= np.linalg.norm(across)
    down = np.cross(ahead, across)
    corner = ahead - HALF * across + HALF * down
    return Rectangle(corner, 2 * HALF * across, -2 * HALF * down, np.zeros((64, 64), np.uint8))


def centroid(image):
    weights = SKY - image
    rows, columns = np.mgrid[0:image.shape[0], 0:image.shape[1]]
    return [np.sum(columns * weights) / weights.sum(), np.sum(rows * weights) / weights.sum()]


def projected(lens, rectangle):
    """The middle of what covers the rectangle in the picture, by OpenCV: of the projections of a fine grid on it, weighed by area."""
    a, b = np.meshgrid(np.linspace(0.0, 1.0, 41), np.linspace(0.0, 1.0, 41))
    points = np.stack([a, b, np.ones_like(a)], axis=-1) @ rectangle.frame.T
    model = cv2.fisheye.projectPoints if isinstance(lens, Fisheye) else cv2.projectPoints
    pixels = model(points.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), lens.intrinsics, np.array(lens.distortion))[0].reshape(41, 41, 2)
    u, v = (np.diff(pixels, axis=axis)[:40, :40] for axis in (0, 1))
    areas = np.abs(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
    middles = 0.25 * (pixels[:-1, :-1] + pixels[1:, :-1] + pixels[:-1, 1:] + pixels[1:, 1:])
    return np.sum(middles * areas[..., None], axis=(0, 1)) / areas.sum()


@pytest.mark.parametrize("lens, degrees", [(Pinhole, (0, 30)), (Radtan, (0, 20, 40)), (Fisheye, (0, 40, 44, 60, 70, 85))],
                         ids=["pinhole", "radtan", "fisheye"])
def test_what_is_drawn_is_where_the_model_projects_it(lens, degrees):
    lens = lens()
    for angle in np.radians(degrees):
        for around in np.radians([40, 130, 230, 310] if isinstance(lens, Fisheye) else [10, 170]):
            direction = np.array([np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)])
            rectangle = square(direction)
            image = lens.draw([rectangle], np.eye(4))
            assert image.min() == 0.0, "nothing at %s" % direction
            if (image[[0, -1]] < SKY).any() or (image[:, [0, -1]] < SKY).any():
                continue  # cut by the border
            expected = projected(lens, rectangle)
            assert centroid(image) == pytest.approx(list(expected), abs=0.15), "%s" % direction


def test_the_fisheye_sees_to_its_sides():
    """And behind the plane of its axis in the corners: what is there leaves its mark in one of them alone."""
    image = Fisheye().draw([square(np.array([np.sin(1.8) * 0.7, np.sin(1.8) * 0.7, np.cos(1.8)]))], np.eye(4))
    assert (image[400:, 400:] < 100).any() and (image[:256] == SKY).all() and (image[:, :256] == SKY).all()


@pytest.mark.parametrize("name, model", [("radtan", "radial-tangential"), ("fisheye", "equidistant")])
def test_the_folder_states_the_lens_and_the_turned_camera(tmp_path, name, model):
    assert main([str(tmp_path / "out"), "--images", "--scene", "room", "--lens", name, "--duration", "5", "--frame-rate", "1",
                 "--quiet"]) == 0
    left, right = (yaml.safe_load((tmp_path / "out" / "mav0" / camera / "sensor.yaml").read_text()) for camera in ("cam0", "cam1"))
    assert left["distortion_model"] == model and left["distortion_coefficients"] == right["distortion_coefficients"] != [0.0] * 4
    picture = cv2.imread(str(next((tmp_path / "out" / "mav0" / "cam0" / "data").iterdir())), cv2.IMREAD_GRAYSCALE)
    assert left["resolution"] == list(picture.shape[::-1])
    rotations = [np.reshape(camera["T_BS"]["data"], (4, 4))[:3, :3] for camera in (left, right)]
    assert np.degrees(np.linalg.norm(cv2.Rodrigues(rotations[0].T @ rotations[1])[0])) == pytest.approx(0.62, abs=0.01)
