"""A real drive that comes back to its beginning closes its loop without ids, and only there."""

import os

import numpy as np
import pytest
import yaml
from conftest import ROOT, data_file

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.evaluation.offline_run import judge, run_bag


def with_places(folder):
    with open(os.path.join(ROOT, "config", "default.yaml")) as file:
        text = file.read()
    # The beginning of the drive must still be in the joint covariance at its end. Whether this one loop is recognised is a
    # close thing (docs/map.md).
    for old, new in (("recognise_places: false", "recognise_places: true"), ("max_landmarks: 2000", "max_landmarks: 3000"),
                     ("max_depth_m: 220.0", "max_depth_m: 200.0")):
        assert old in text
        text = text.replace(old, new)
    config = folder / "places.yaml"
    config.write_text(text)
    return str(config)


@pytest.mark.parametrize("drive, places", [("0027", 1), ("0034", 0)])
def test_a_loop_is_closed_where_there_is_one(drive, places, tmp_path):
    bag, run = str(tmp_path / "drive.bag"), str(tmp_path / "run")
    truth = data_file(drive + "_truth_left_camera.txt")
    assert convert([data_file(drive + ".npz"), bag, "--truth", truth, "--quiet"]) == 0
    run_bag(bag, with_places(tmp_path), run)
    with open(os.path.join(run, "summary.yaml")) as file:
        assert yaml.safe_load(file)["places_recognised"] == places
    if not places:
        return
    assert judge(bag, run).slam.ate <= 2.6
    # The last frames drive over the first ones; without the loop closed the gap is 5 m wrong.
    trajectory = np.loadtxt(os.path.join(run, "trajectory.tum"))
    gap = np.linalg.norm(trajectory[1100, 1:4] - trajectory[14, 1:4])
    truth_rows = np.loadtxt(truth).reshape(-1, 3, 4)
    driven = np.linalg.norm(truth_rows[1100, :, 3] - truth_rows[14, :, 3])
    assert abs(gap - driven) < 1.0
