"""Trajectory errors against values worked out by hand, and against the known errors of dead reckoning on real drives."""

import numpy as np
import pytest
from conftest import data_file

from vi_ekf_slam.dataset import load_dataset
from vi_ekf_slam.dead_reckoning import dead_reckon
from vi_ekf_slam.geometry import make_transform, se3_exp, so3_exp
from vi_ekf_slam.metrics import absolute_trajectory_error, kitti_errors, left_camera_poses, rigid_alignment
from vi_ekf_slam.pose_files import read_pose_file


def straight_drive(frames, spacing):
    """Poses that face along x, `spacing` m apart."""
    return np.array([make_transform(np.eye(3), [spacing * k, 0.0, 0.0]) for k in range(frames)])


def test_alignment_recovers_a_rigid_motion():
    points = np.random.default_rng(1).normal(size=(30, 3))
    motion = se3_exp([1.0, -2.0, 3.0, 0.4, -2.0, 1.0])
    assert np.allclose(rigid_alignment(points, points @ motion[:3, :3].T + motion[:3, 3]), motion)


def test_alignment_never_mirrors():
    points = np.random.default_rng(2).normal(size=(30, 3))
    assert np.linalg.det(rigid_alignment(points, points * [1, 1, -1])[:3, :3]) == pytest.approx(1.0)


def test_ate_of_an_equal_shape_is_zero():
    truth = np.random.default_rng(3).normal(size=(20, 3))
    assert absolute_trajectory_error(truth @ so3_exp([0.1, 0.2, 3.0]).T + 7.0, truth) == pytest.approx(0.0, abs=1e-12)


def test_ate_by_hand():
    # Corners of a square of side 2; one pair of opposite corners lifted by 1 and the other lowered by 1. By symmetry no
    # motion helps, so every corner is off by exactly 1.
    square = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]])
    warped = square + np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 0, 1.0], [0, 0, -1.0]])
    assert absolute_trajectory_error(warped, square) == pytest.approx(1.0)


def test_ate_does_not_correct_scale():
    # Points at -1, 0, 1 m against -2, 0, 2 m: residuals 1, 0, 1.
    line = np.array([[-1.0, 0, 0], [0.0, 0, 0], [1.0, 0, 0]])
    assert absolute_trajectory_error(2 * line, line) == pytest.approx(np.sqrt(2.0 / 3.0))


def test_different_lengths_are_an_error():
    with pytest.raises(ValueError):
        absolute_trajectory_error(np.zeros((3, 3)), np.zeros((4, 3)))


def test_kitti_scale_error_by_hand():
    # 1 % too long. A sub-sequence ends at the first frame MORE than L away: on a grid of 10 m, 100 m ends after 110 m,
    # where the estimate is 1.1 m off: 1.1 % of the nominal length. 200 m: 2.1 m of 200 m, 1.05 %.
    truth, estimate = straight_drive(31, 10.0), straight_drive(31, 10.1)
    errors = kitti_errors(estimate, truth, lengths=(100.0, 200.0), step=30)
    assert errors.count == 2  # frame 30 starts none
    assert errors.t_rel == pytest.approx((1.1 + 1.05) / 2)
    assert errors.r_rel == pytest.approx(0.0, abs=1e-5)


def test_kitti_rotation_error_by_hand():
    # The estimate turns by 0.02 deg a frame of 1 m where the truth goes straight; after 101 m: 2.02 deg of 100 m.
    truth = straight_drive(102, 1.0)
    estimate = np.array([make_transform(so3_exp([0, 0, np.radians(0.02 * k)]), p[:3, 3]) for k, p in enumerate(truth)])
    errors = kitti_errors(estimate, truth, step=102)
    assert errors.count == 1
    assert errors.r_rel == pytest.approx(2.02)


def test_kitti_starts_every_tenth_frame():
    # 1 m spacing, 131 frames: starts at 0, 10, 20 have 101 m ahead of them; a start at 30 has 100 m only.
    assert kitti_errors(*[straight_drive(131, 1.0)] * 2).count == 3


def test_kitti_errors_of_a_short_drive_are_undefined():
    errors = kitti_errors(*[straight_drive(50, 1.0)] * 2)
    assert errors.count == 0 and np.isnan(errors.t_rel) and np.isnan(errors.r_rel)


def test_left_camera_poses_by_hand():
    # Camera 1 m ahead of the IMU with the IMU's axes; the IMU turns left by 90 deg on the spot. In camera 0, which sits
    # at (1, 0, 0), the camera goes to (0, 1, 0) - (1, 0, 0).
    cam_T_imu = make_transform(np.eye(3), [-1.0, 0.0, 0.0])
    poses = left_camera_poses([np.eye(4), make_transform(so3_exp([0, 0, np.pi / 2]), [0, 0, 0])], cam_T_imu)
    assert np.allclose(poses[0], np.eye(4))
    assert np.allclose(poses[1][:3, 3], [-1.0, 1.0, 0.0])


# Figures worked out once by independent code: ATE in m, t_rel in %, r_rel in deg/100 m.
KNOWN = [
    ("0027", "given", 16.36, 8.24, 6.21), ("0027", "repaired", 15.75, 8.19, 6.21),
    ("0034", "given", 52.83, 23.38, 11.67), ("0034", "repaired", 53.65, 23.72, 11.67),
    ("extra_0036", "repaired", 0.16, 1.89, 1.80), ("extra_0095", "repaired", 0.70, 3.10, 0.53),
]


@pytest.mark.parametrize("name, reading, ate, t_rel, r_rel", KNOWN)
def test_known_errors_of_dead_reckoning(name, reading, ate, t_rel, r_rel):
    dataset = load_dataset(data_file(name + ".npz"), extrinsic=reading)
    _, truth = read_pose_file(data_file(name + "_truth_left_camera.txt"))
    world_T_imu = dead_reckon(dataset.stamps, dataset.linear_velocity, dataset.angular_velocity)
    estimate = left_camera_poses(world_T_imu, dataset.cam_T_imu)[: len(truth)]
    errors = kitti_errors(estimate, truth)
    assert absolute_trajectory_error(estimate, truth) == pytest.approx(ate, abs=0.0051)
    assert errors.t_rel == pytest.approx(t_rel, abs=0.0051)
    assert errors.r_rel == pytest.approx(r_rel, abs=0.0051)
