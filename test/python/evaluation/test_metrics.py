"""Trajectory errors against values worked out by hand, and against the known errors of dead reckoning on real drives."""

import numpy as np
import pytest
from conftest import data_file, dead_reckon, se3_exp

from vi_ekf_slam.common.geometry import make_transform, so3_exp
from vi_ekf_slam.dataset.loader import load_dataset
from vi_ekf_slam.dataset.pose_files import read_pose_file
from vi_ekf_slam.evaluation.metrics import (absolute_trajectory_error, anchored_errors, distances, kitti_segments,
                                            left_camera_poses, mean_kitti_errors, pairs_ahead, relative_pose_errors,
                                            rigid_alignment)


def kitti_errors(*arguments, **options):
    return mean_kitti_errors(kitti_segments(*arguments, **options))


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


def test_kitti_segments_are_kept_apart_by_length():
    # The same example: 100 m, of which 1.1 m are wrong, from frames 0 and 10; 200 m, 2.1 m wrong, from frame 0.
    segments = kitti_segments(straight_drive(31, 10.1), straight_drive(31, 10.0), lengths=(100.0, 200.0), step=10)
    assert np.allclose(segments, [[100, 0.011, 0], [200, 0.0105, 0], [100, 0.011, 0]], atol=1e-7)


def test_anchored_error_by_hand():
    # The same places 10 m apart, but the estimate believes at first that it faces 60 deg to the left: seen from its start
    # the rest lies on the third side of an equilateral triangle, 10 m and 20 m off. Aligned it would be perfect.
    truth = straight_drive(3, 10.0)
    estimate = truth.copy()
    estimate[0, :3, :3] = so3_exp([0, 0, np.pi / 3])
    world = se3_exp([3, -2, 1, 0.3, 0.2, 2.0])
    assert np.allclose(anchored_errors(world @ estimate, truth), [0.0, 10.0, 20.0])
    assert absolute_trajectory_error(world @ estimate, truth) == pytest.approx(0.0, abs=1e-9)


def test_distance_is_along_the_way():
    assert np.allclose(distances(np.array([[0.0, 0, 0], [3.0, 4.0, 0], [3.0, 4.0, 12.0], [0.0, 0, 12.0]])), [0, 5, 17, 22])


def test_what_spans_a_gap_is_left_out():
    # 1 m a frame, of which 50 are missing in the middle: 150 m on either side, and 51 m across that are not known.
    truth = straight_drive(351, 1.0)[np.r_[0:151, 201:351]]
    estimate, sections = truth.copy(), np.repeat([0, 1], [151, 150])
    estimate[151:, 0, 3] += 7.0  # lost in the gap
    assert distances(truth, sections)[-1] == pytest.approx(150.0 + 149.0) and distances(truth)[-1] == pytest.approx(350.0)
    first, last = pairs_ahead(np.arange(301), 1, sections)
    assert len(first) == 299 and not np.any((first <= 150) & (last > 150))
    assert relative_pose_errors(estimate, truth, (first, last)).translation == pytest.approx(0.0, abs=1e-9)
    segments = kitti_segments(estimate, truth, sections=sections)
    assert len(segments) == 5 + 4 and np.allclose(segments[:, 1], 0.0)  # 100 m from the rows 0 to 40 and 160 to 190
    assert kitti_segments(estimate, truth)[:, 1].max() > 0.03


def test_pairs_reach_to_the_first_row_that_is_far_enough():
    first, last = pairs_ahead(np.array([0.0, 1.0, 5.0, 6.5]), 2.0)
    assert list(first) == [0, 1] and list(last) == [2, 2]
    stamps = 1317386425.5 + 0.1 * np.arange(4)  # 0.2 s, give or take the rounding of such large numbers
    first, last = pairs_ahead(stamps, 0.2)
    assert list(first) == [0, 1] and list(last) == [2, 3]
    assert len(pairs_ahead(stamps, 1.0)[0]) == 0


def test_relative_pose_error_by_hand():
    # Steps of 1 m in the truth, of 1.3 m and 0.6 m in the estimate: errors 0.3 and 0.4 m.
    truth, estimate = straight_drive(3, 1.0), straight_drive(3, 1.0)
    estimate[:, 0, 3] = [0.0, 1.3, 1.9]
    errors = relative_pose_errors(estimate, truth, pairs_ahead(np.arange(3), 1))
    assert errors.translation == pytest.approx(np.sqrt((0.09 + 0.16) / 2)) and errors.count == 2
    assert errors.rotation == pytest.approx(0.0, abs=1e-6)


def test_relative_pose_error_counts_rotation_and_not_the_world_frame():
    # The estimate turns by 2 deg a frame on the spot; over two frames that is 4 deg.
    truth = np.array([np.eye(4)] * 5)
    estimate = np.array([se3_exp([0, 0, 0, 0, 0, np.radians(2.0 * k)]) for k in range(5)])
    errors = relative_pose_errors(se3_exp([3, -2, 1, 0.3, 0.2, 2.0]) @ estimate, truth, pairs_ahead(np.arange(5), 2))
    assert errors.rotation == pytest.approx(4.0) and errors.translation == pytest.approx(0.0, abs=1e-12)
    assert errors.count == 3


def test_relative_pose_error_of_no_pairs_is_undefined():
    errors = relative_pose_errors(straight_drive(2, 1.0), straight_drive(2, 1.0), pairs_ahead(np.arange(2), 5))
    assert errors.count == 0 and np.isnan(errors.translation) and np.isnan(errors.rotation)


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
