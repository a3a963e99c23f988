"""Laws of the transforms, and values by hand."""

import numpy as np
import pytest
from conftest import dead_reckon, se3_exp

from vi_ekf_slam.common import geometry as g

ANGLES = [0.0, 1e-9, 1e-6, 1e-3, 1.0, 3.0, np.pi - 1e-7]
AXES = [np.array(a) / np.linalg.norm(a) for a in ([1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [1.0, -2.0, 0.5])]


@pytest.mark.parametrize("angle", ANGLES)
def test_log_undoes_exp(angle):
    for axis in AXES:
        assert np.allclose(g.so3_log(g.so3_exp(angle * axis)), angle * axis, rtol=0, atol=2e-9)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_is_the_limit_of_small_steps(angle):
    step = g.so3_exp(angle * AXES[3] / 2**12)
    assert np.allclose(np.linalg.matrix_power(step, 2**12), g.so3_exp(angle * AXES[3]), rtol=0, atol=1e-10)


@pytest.mark.parametrize("angle", ANGLES)
def test_log_undoes_exp_of_motions(angle):
    xi = np.concatenate([[1.0, -2.0, 0.5], angle * AXES[3]])
    assert np.allclose(g.se3_log(se3_exp(xi)), xi, rtol=0, atol=1e-7 if angle > 3.1 else 2e-9)


@pytest.mark.parametrize("angle", ANGLES + [np.pi])
def test_quaternion_round_trip(angle):
    for axis in AXES:
        rotation = g.so3_exp(angle * axis)
        assert np.allclose(g.quaternion_to_rotation(g.rotation_to_quaternion(rotation)), rotation, rtol=0, atol=1e-12)


def test_quaternion_order_is_x_y_z_w():
    quarter_turn_left = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.allclose(g.rotation_to_quaternion(quarter_turn_left), [0, 0, np.sqrt(0.5), np.sqrt(0.5)])


def test_inverse_of_a_batch():
    poses = np.array([se3_exp([1, 2, 3, 0.1 * k, 0.2, -0.3 * k]) for k in range(5)])
    assert np.allclose(g.inverse(poses) @ poses, np.eye(4))


def test_a_mirror_is_not_a_rotation():
    assert g.rotation_error(np.diag([1.0, 1.0, -1.0])) == np.inf
    assert g.rotation_error(np.eye(3)) == 0.0
    assert g.rotation_error(np.diag([1.0, 1.1, 1.0])) == pytest.approx(0.21)


def test_dead_reckoning_holds_the_sample_at_the_start_of_a_step():
    velocity = np.array([[1.0, 100.0], [0.0, 0.0], [0.0, 0.0]])
    poses = dead_reckon(np.array([0.0, 2.0]), velocity, np.zeros((3, 2)))
    assert np.allclose(poses[1][:3, 3], [2.0, 0.0, 0.0])


def test_dead_reckoning_drives_a_circle():
    frames = 101
    stamps = np.linspace(0.0, 2 * np.pi, frames)
    poses = dead_reckon(stamps, np.tile([[1.0], [0.0], [0.0]], frames), np.tile([[0.0], [0.0], [1.0]], frames))
    assert np.allclose(poses[-1], np.eye(4), atol=1e-12)
    assert np.allclose(poses[50][:3, 3], [0.0, 2.0, 0.0], atol=1e-12)  # half way round: a diameter to the left
