"""Ellipses of landmarks in a picture from above."""

import numpy as np
import pytest

from vi_ekf_slam.evaluation import top_view


def test_ellipses_do_not_pile_up():
    # A hundred landmarks in one square metre and one alone: of the crowd only that with the median deviation is chosen.
    limits = ((0.0, 100.0), (0.0, 50.0))
    points = np.vstack([np.random.default_rng(1).uniform(10.0, 11.0, (100, 3)), [[60.0, 40.0, 0]], [[500.0, 0, 0]]])
    deviations = np.concatenate([np.arange(1.0, 101.0), [3.0, 4.0]])
    assert list(top_view.spread_out(points, deviations, limits, 5.0)) == [49, 100]


@pytest.mark.parametrize("deviation, factor", [(0.001, 100), (0.1, 10), (0.5, 2), (1.0, 1), (50.0, 1)])
def test_ellipses_are_enlarged_until_they_are_seen(deviation, factor):
    # In squares of 5 m an ellipse may reach 2.5 m to a side, and reaches 2.45 deviations.
    assert top_view.enlargement(np.full(9, deviation), 5.0) == factor


def test_an_ellipse_has_the_axes_of_its_covariance():
    # [[2, 1], [1, 2]] m^2: standard deviations sqrt(3) m at 45 deg and 1 m; 95 % lie within 2.4477 of them.
    covariance = np.array([[[2.0, 1.0, 0], [1.0, 2.0, 0], [0, 0, 1.0]]])
    line = np.array([[0.0, 0, 0], [200.0, 100.0, 0]])
    landmark, deviation = np.array([[100.0, 50.0, 0]]), np.array([np.sqrt(3.0)])
    figure = top_view.draw_run("drive", line, None, None, landmark, deviation, covariance)
    assert "ellipses: 95 % of 1 landmarks" in figure.axes[0].texts[0].get_text()
    outline = next(c for c in figure.axes[0].collections if c.__class__.__name__ == "LineCollection").get_segments()[0]
    radii = np.linalg.norm(outline - [100.0, 50.0], axis=1)
    farthest = outline[np.argmax(radii)] - [100.0, 50.0]
    assert radii.max() == pytest.approx(2.4477 * np.sqrt(3.0)) and radii.min() == pytest.approx(2.4477)
    assert farthest[0] == pytest.approx(farthest[1])
