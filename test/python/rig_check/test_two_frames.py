"""Motion between two frames: without bias where disparities are noisy, and as good as it says."""

import numpy as np
import pytest
import rigs

from vi_ekf_slam.common.geometry import so3_exp, so3_log
from vi_ekf_slam.rig_check.two_frames import refine

BASELINE, COUNT, TRIALS = 0.05, 100, 60
AFTER_R_BEFORE, TRANSLATION = so3_exp(np.array([0.01, -0.03, 0.02])), np.array([0.08, -0.03, 0.1])


def scene(random, sigma):
    """(before (N, 4), after (N, 2) px) of points 2 to 6 m away."""
    points = np.column_stack([random.uniform(-2.0, 2.0, COUNT), random.uniform(-1.2, 1.2, COUNT), random.uniform(2.0, 6.0, COUNT)])
    first, second = (q @ rigs.K.T / q[:, 2:] for q in (points, points @ AFTER_R_BEFORE.T + TRANSLATION))
    disparity = rigs.K[0, 0] * BASELINE / points[:, 2]
    before = np.column_stack([first[:, :2], first[:, 0] - disparity, first[:, 1]])
    return before + sigma * random.normal(size=before.shape), second[:, :2] + sigma * random.normal(size=(COUNT, 2))


def solve(before, after, agree):
    return refine(rigs.K, BASELINE, before, after, (np.eye(3), np.zeros(3)), agree)


def test_without_noise_the_motion_is_exact():
    rotation, translation, sigma, agree = solve(*scene(np.random.default_rng(1), 1e-7), np.ones(COUNT, dtype=bool))
    np.testing.assert_allclose(rotation, AFTER_R_BEFORE, atol=1e-7)
    np.testing.assert_allclose(translation, TRANSLATION, atol=1e-7)
    assert sigma < 1e-7 and agree.mean() > 0.9


def test_noise_of_disparities_does_not_attenuate_the_translation():
    random = np.random.default_rng(1)
    found = [solve(*scene(random, 0.5), np.ones(COUNT, dtype=bool)) for _ in range(TRIALS)]
    ratios = [translation @ TRANSLATION / (TRANSLATION @ TRANSLATION) for _, translation, _, _ in found]
    assert np.mean(ratios) == pytest.approx(1.0, abs=3.0 * np.std(ratios) / np.sqrt(TRIALS))
    errors = np.array([so3_log(rotation @ AFTER_R_BEFORE.T) for rotation, _, _, _ in found])
    assert np.linalg.norm(errors.mean(axis=0)) < 3.0 * np.sqrt(np.sum(errors**2)) / TRIALS
    assert np.sqrt(np.sum(errors**2) / TRIALS) == pytest.approx(np.mean([sigma for _, _, sigma, _ in found]), rel=0.2)


def test_points_that_move_on_their_own_are_left_out():
    before, after = scene(np.random.default_rng(1), 0.2)
    after[:30] += 8.0
    start = np.arange(COUNT) % 10 > 0  # some of them are in to begin with
    rotation, translation, _, agree = solve(before, after, start)
    assert not agree[:30].any() and agree[30:].mean() > 0.9
    assert np.linalg.norm(translation - TRANSLATION) < 0.02 and np.linalg.norm(so3_log(rotation @ AFTER_R_BEFORE.T)) < 0.005


def test_where_disparities_are_noise_no_translation_is_told():
    random = np.random.default_rng(1)
    before, after = scene(random, 0.5)
    before[:, 2] = before[:, 0] + 0.5 * random.normal(size=COUNT)
    _, translation, _, _ = solve(before, after, np.ones(COUNT, dtype=bool))
    assert np.isnan(translation).all() or np.linalg.norm(translation) > 10.0 * np.linalg.norm(TRANSLATION)
