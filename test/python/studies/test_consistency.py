"""The default estimator's covariance tells the truth: a short version of the study that the program monte_carlo does.

Over few seeds the mean NEES scatters, so the bounds are wider than those of the full study (50 seeds: 5.08 to 7.00).
"""

import csv
import os
import subprocess

import numpy as np
import pytest
import yaml
from conftest import HANG_S, ROOT

from vi_ekf_slam.common.package_files import package_program
from vi_ekf_slam.evaluation.consistency import chi_square_bounds

CONFIG = os.path.join(ROOT, "config", "default.yaml")
SEEDS = 14
RARE = 0.001  # the share that lies outside


def bounds(seeds):
    """Between which the mean of `seeds` NEES of 6 degrees of freedom lies but for one in a thousand."""
    return tuple(bound / seeds for bound in chi_square_bounds(6.0 * seeds, RARE))


def study(config, folder, *arguments, seeds=SEEDS):
    """Rows of seeds.csv and check_points.csv as columns {name: (N,)}, and the exit code."""
    command = [package_program("monte_carlo"), "--config", str(config), "--output", str(folder),
               "--seeds", str(seeds), "--quiet", *arguments]
    done = subprocess.run(command, stderr=subprocess.PIPE, universal_newlines=True, timeout=HANG_S, check=False)
    assert done.returncode in (0, 3), done.stderr
    tables = []
    for name in ("seeds.csv", "check_points.csv"):
        with open(str(folder / name), encoding="ascii", newline="") as stream:
            rows = list(csv.DictReader(stream))
        tables.append({key: np.array([float(row[key]) for row in rows]) for key in rows[0]})
    return tables[0], tables[1], done.returncode


def mean_nees(check_points):
    """Mean over the seeds at each check point, in their order."""
    return [check_points["nees"][check_points["share"] == share].mean() for share in (0.25, 0.5, 0.75, 1.0)]


def told_the_truth(folder, **changes):
    """The default configuration, told that simulated tracks do not slip and that all axes turn alike (which only --motion
    process has), with `changes` of its section invariant."""
    with open(CONFIG, encoding="utf-8") as stream:
        parameters = yaml.safe_load(stream)
    density = parameters["invariant"]["twist_density"]
    parameters["invariant"].update(slip_sigma=0.0, twist_density=density[:3] + 3 * density[3:4],
                                   **changes)
    path = folder / "told.yaml"
    path.write_text(yaml.safe_dump(parameters))
    return path


@pytest.fixture(scope="module")
def process(tmp_path_factory):
    folder = tmp_path_factory.mktemp("process")
    return study(told_the_truth(folder, pixel_sigma=0.7), folder, "--motion", "process", "--set", "duration=40",
                 "--set", "pixel-sigma=0.7")


@pytest.fixture(scope="module")
def car(tmp_path_factory):
    folder = tmp_path_factory.mktemp("car")
    return study(told_the_truth(folder), folder, "--set", "laps=1")


def test_pose_error_is_as_large_as_claimed_when_the_motion_follows_the_model(process):
    low, high = bounds(SEEDS)
    assert all(low <= nees <= high for nees in mean_nees(process[1])), mean_nees(process[1])


def test_innovations_are_as_large_as_claimed_when_the_motion_follows_the_model(process):
    assert abs(process[0]["nis_per_dof"].mean() - 1.0) <= 0.03


def test_pose_error_of_a_car_is_at_most_as_large_as_claimed(car):
    assert all(nees <= bounds(SEEDS)[1] for nees in mean_nees(car[1])), mean_nees(car[1])


def test_a_filter_that_believes_its_pixels_too_much_fails_the_same_study(tmp_path):
    config = told_the_truth(tmp_path, pixel_sigma=0.6)
    low, high = bounds(10)
    seeds, check_points, code = study(config, tmp_path, "--motion", "process", "--set", "duration=40", "--check",
                                      "%s,%s" % (low, high), seeds=10)
    assert code == 3 and max(mean_nees(check_points)) > high
    assert seeds["nis_per_dof"].mean() > 1.5


# The paper's filter with its camera switched on and the simulation's true noise.
PAPER = """
estimator: paper
paper:
  mode: slam
  motion_noise: [0.0025, 0.0025, 0.0025, 0.000025, 0.000025, 0.000025]
  pixel_noise: 0.49
  prior_pose_variance: 0.0
  prior_landmark_variance: 100.0
  landmark_fraction: 0.2
  max_depth_m: 150.0
"""


def test_the_papers_filter_fails_the_same_study(tmp_path):
    config = tmp_path / "paper.yaml"
    config.write_text(PAPER)
    low, high = bounds(10)
    seeds, check_points, code = study(config, tmp_path, "--motion", "process", "--set", "duration=20", "--set",
                                      "features-max=60", "--check", "%s,%s" % (low, high), seeds=10)
    assert code == 3 and max(mean_nees(check_points)) > 5.0 * high
    assert seeds["yaw_variance_fall"].max() > 0.1
    assert seeds["position_rmse"].mean() < seeds["dead_reckoning_rmse"].mean()  # its camera is on
