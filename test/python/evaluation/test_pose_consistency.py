"""Errors, covariances and what ties them: NEES by hand, its coordinates, and its bounds from the tables."""

import numpy as np
import pytest
from conftest import se3_exp

from vi_ekf_slam.common.geometry import make_transform, so3_exp
from vi_ekf_slam.evaluation.against_truth import evaluate, judge_covariances
from vi_ekf_slam.evaluation.consistency import chi_square_bounds, nees, pose_errors


def test_errors_are_about_the_axes_of_the_world():
    # The truth faces left; 0.1 rad about the WORLD's x axis is a pitch of the body, and must come out as x all the same.
    truth = make_transform(so3_exp([0, 0, np.pi / 2]), [10.0, 0, 0])
    estimate = make_transform(so3_exp([0.1, 0, 0]) @ truth[:3, :3], [11.0, 2.0, -3.0])
    assert np.allclose(pose_errors([estimate], [truth]), [[1, 2, -3, 0.1, 0, 0]])


def test_nees_by_hand():
    # Six times two standard deviations: 6 x 4.
    deviations = np.array([1.0, 2.0, 3.0, 0.01, 0.02, 0.03])
    assert nees([2.0 * deviations], [np.diag(deviations**2)])[0] == pytest.approx(24.0)
    # inv([[2, 1], [1, 2]]) = [[2, -1], [-1, 2]] / 3.
    covariance = np.array([[2.0, 1.0], [1.0, 2.0]])
    assert np.allclose(nees([[1.0, 1.0], [1.0, -1.0]], [covariance] * 2), [2.0 / 3.0, 2.0])


def test_nees_of_a_useless_covariance_is_undefined():
    assert np.isnan(nees([[0.0, 0.0]] * 3, [np.zeros((2, 2)), [[1.0, 2.0], [2.0, 1.0]], [[np.nan, 0], [0, 1]]])).all()


def test_bounds_are_those_of_the_tables():
    assert np.allclose(chi_square_bounds(6), (1.237, 14.449), rtol=0, atol=0.04)  # an approximation: worst at few dof
    assert np.allclose(chi_square_bounds(177), (142.0, 215.7), rtol=0, atol=0.2)


def test_truth_is_laid_onto_the_first_common_pose():
    # The estimate is right but for 0.3 m of y and 0.02 rad of yaw in its last pose.
    stamps, deviations = np.arange(1.0, 5.0), np.array([0.1, 0.1, 0.1, 0.01, 0.01, 0.01])
    poses = np.array([se3_exp([5.0 * k, 0, 0, 0, 0, 0.1 * k]) for k in range(4)])
    truth = (stamps[1:], se3_exp([3, -2, 1, 0.3, 0.2, 2.0]) @ poses[1:])
    wrong = poses.copy()
    wrong[3] = make_transform(so3_exp([0, 0, 0.02]) @ poses[3][:3, :3], poses[3][:3, 3] + [0, 0.3, 0])
    judged = judge_covariances(stamps, wrong, np.array([np.diag(deviations**2)] * 4), truth)
    assert np.array_equal(judged.stamps, stamps[1:]) and np.allclose(judged.deviations, deviations)
    assert np.allclose(judged.errors, [[0] * 6] * 2 + [[0, 0.3, 0, 0, 0, 0.02]], atol=1e-9)
    assert np.allclose(judged.nees, [0, 0, 9 + 4], atol=1e-9)
    assert judged.nees_position[2] == pytest.approx(9.0) and judged.nees_rotation[2] == pytest.approx(4.0)


def test_without_truth_there_are_deviations_only():
    judged = judge_covariances(np.array([1.0, 2.0]), np.array([np.eye(4)] * 2), np.array([4.0 * np.eye(6), -np.eye(6)]))
    assert judged.errors is None and judged.nees is None
    assert np.allclose(judged.deviations[0], 2.0) and np.isnan(judged.deviations[1]).all()


def test_the_right_covariance_has_a_nees_of_six():
    # Errors drawn in the coordinates that covariance.csv has: p = p^ + dp, R = Exp(dtheta) R^.
    random = np.random.default_rng(5)
    factor = np.diag([1.0, 0.1, 0.3, 0.03, 0.01, 0.02]) @ (np.eye(6) + 0.5 * random.normal(size=(6, 6)))
    covariance = factor @ factor.T
    estimate = make_transform(so3_exp([0.3, -1.0, 2.0]), [300.0, -200.0, 10.0])
    drawn = random.normal(size=(2000, 6)) @ factor.T
    truth = [make_transform(so3_exp(d[3:]) @ estimate[:3, :3], estimate[:3, 3] + d[:3]) for d in drawn]
    values = nees(pose_errors([estimate] * 2000, truth), [covariance] * 2000)
    assert np.mean(values) == pytest.approx(6.0, abs=0.3)  # its standard deviation is sqrt(12 / 2000) = 0.08


def test_truth_that_comes_once_a_second_is_compared_at_its_own_stamps():
    # Shaken at 0.7 Hz: a straight line between true poses a second apart would be wrong by 0.1 m and 0.3 rad; between
    # poses 0.05 s apart it is by 0.6 mm and 1.8 mrad at most, a curvature times 0.05^2 / 8.
    def pose(t):
        return make_transform(so3_exp([0.3 * np.sin(4.4 * t), 0, 0]), [t, 0.1 * np.sin(4.4 * t), 0])
    stamps, true_stamps = 100.0 + 0.05 * np.arange(401), 100.21 + np.arange(19)
    poses, truth = (np.array([pose(t) for t in s]) for s in (stamps, true_stamps))
    covariances = np.array([(1.0 + k) * np.eye(6) for k in range(401)])
    judged = judge_covariances(stamps, poses, covariances, (true_stamps, truth), "none")
    assert np.array_equal(judged.stamps, true_stamps) and np.abs(judged.errors).max() < 2e-3
    assert np.allclose(judged.deviations[:, 0] ** 2, 1.0 + 4 + 20 * np.arange(19))  # 100.21 is nearest to 100.20
    evaluation = evaluate(stamps, poses, (true_stamps, truth), gauge="yaw")
    assert evaluation.matched == 19 and evaluation.truth_step == pytest.approx(1.0)
    assert evaluation.ate < 1e-3 and evaluation.orientation < np.degrees(2e-3)

    # One as dense as the trajectory is interpolated, though its stamps jitter and some are missing.
    dense = np.delete(stamps, slice(100, 120)) + 1e-3 * np.random.default_rng(1).uniform(size=381)
    evaluation = evaluate(stamps, poses, (dense, np.array([pose(t) for t in dense])))
    assert evaluation.matched == 400 and evaluation.truth_step is None
