"""Cameras that draw a scene: one that leaves straight lines straight, and lenses that bend them."""

import cv2
import numpy as np

from vi_ekf_slam.simulation.pictures.scene import draw

NEWTON_STEPS = 20
DENSITY = 1.3  # pixels that are drawn for one of the picture, where a lens shows most
# Rows: right, down and ahead of a camera that looks through one side of a cube, in the axes of the lens.
SIDES = [np.array(rows, dtype=float) for rows in (
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)), ((0, 0, 1), (0, 1, 0), (-1, 0, 0)), ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    ((1, 0, 0), (0, 0, 1), (0, -1, 0)), ((1, 0, 0), (0, 0, -1), (0, 1, 0)))]


class Pinhole:
    """A pair of these is rectified. size (width, height) and focal_length in px, right_turned in rad: the right camera's axes."""

    size, focal_length, right_turned = (640, 400), 400.0, (0.0, 0.0, 0.0)
    model, distortion = "radial-tangential", (0.0, 0.0, 0.0, 0.0)

    def __init__(self):
        self.intrinsics = np.array([[self.focal_length, 0, 0.5 * (self.size[0] - 1)],
                                    [0, self.focal_length, 0.5 * (self.size[1] - 1)], [0, 0, 1.0]])

    def draw(self, rectangles, cam_T_world):
        """The picture (height, width) float32."""
        return draw(rectangles, cam_T_world, self.intrinsics, self.size)


class _Bent(Pinhole):
    """Put together from what pinhole cameras see through the sides of a cube."""

    right_turned = (0.004, -0.006, 0.008)

    def __init__(self):
        super().__init__()
        half = np.ceil(DENSITY * self.focal_length)  # px from the middle of a side to 45 deg
        self._side_size = 2 * int(half) + 4  # some more, so that sides meet without a seam
        middle = 0.5 * (self._side_size - 1)
        self._side_intrinsics = np.array([[half, 0, middle], [0, half, middle], [0, 0, 1.0]])
        rays = self.rays()
        nearest = np.argmax([rays @ side[2] for side in SIDES], axis=0)
        self._parts = []  # side, where it is in the picture: a box, and which of its pixels; the side's pixels for the box
        for k, side in enumerate(SIDES):
            rows, columns = np.nonzero(nearest == k)
            if not len(rows):
                continue
            box = (slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1))
            where, seen = nearest[box] == k, rays[box] @ side.T
            seen[~where] = (0.0, 0.0, 1.0)
            self._parts.append((side, box, where, (half * seen[..., :2] / seen[..., 2:] + middle).astype(np.float32)))

    def rays(self):
        """(height, width, 3): directions of the pixels, in optical axes; any length."""
        raise NotImplementedError

    def draw(self, rectangles, cam_T_world):
        """The picture (height, width) float32."""
        image = np.empty(self.size[::-1], dtype=np.float32)
        for side, box, where, pixels in self._parts:
            side_T_world = np.vstack([side @ cam_T_world[:3], [0.0, 0.0, 0.0, 1.0]])
            drawn = draw(rectangles, side_T_world, self._side_intrinsics, (self._side_size, self._side_size))
            image[box][where] = cv2.remap(drawn, pixels, None, cv2.INTER_LINEAR)[where]
        return image

    def _grid(self):
        """(height, width, 2): the pixels."""
        return np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in self.size)), axis=-1)


class Radtan(_Bent):
    """Brown and Conrady's model, with about the distortion of EuRoC's cameras."""

    focal_length = 390.0
    distortion = (-0.28, 0.074, 0.0002, 0.00002)

    def rays(self):
        """(height, width, 3): directions of the pixels, in optical axes; any length."""
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-10)
        flat = cv2.undistortPointsIter(self._grid().reshape(-1, 1, 2), self.intrinsics, np.array(self.distortion), None, None,
                                       criteria).reshape(*self.size[::-1], 2)
        return np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)


class Fisheye(_Bent):
    """Kannala and Brandt's model, with about the distortion of TUM-VI's cameras: 77 deg to the sides, more to the corners."""

    size, focal_length = (512, 512), 190.0
    model, distortion = "equidistant", (0.0035, 0.0007, -0.002, 0.0002)

    def rays(self):
        """(height, width, 3): directions of the pixels, in optical axes; any length."""
        at = (self._grid() - self.intrinsics[:2, 2]) / self.focal_length
        bent = np.linalg.norm(at, axis=-1)
        series = np.polynomial.Polynomial(np.ravel([(0.0, c) for c in (1.0,) + self.distortion]))
        angle = bent.copy()
        for _ in range(NEWTON_STEPS):
            angle -= (series(angle) - bent) / series.deriv()(angle)
        return np.concatenate([(np.sin(angle) / bent)[..., None] * at, np.cos(angle)[..., None]], axis=-1)
