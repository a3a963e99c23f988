"""The real drives through the default configuration are as accurate as they must be."""

import os

import pytest
from conftest import ROOT, data_file

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.evaluation.offline_run import judge, run_bag

CONFIG = os.path.join(ROOT, "config", "default.yaml")

# Upper limits of ATE in m, KITTI's t_rel in % and r_rel in deg per 100 m, all of the left camera.
LIMITS = {"0027": (2.6, 1.42, 1.15), "0034": (2.0, 1.35, 0.90)}
# Frames with truth and the ATE of dead reckoning in m: guards against comparing the wrong things.
FACTS = {"0027": (1101, 15.8), "0034": (1201, 53.7)}


@pytest.fixture(scope="module", params=sorted(LIMITS))
def judged(request, tmp_path_factory):
    """(drive, Judgement) of a drive that dataset_to_bag.py converted and run_bag ran."""
    drive, folder = request.param, tmp_path_factory.mktemp("accuracy")
    bag, run = str(folder / "drive.bag"), str(folder / "run")
    truth = data_file(drive + "_truth_left_camera.txt")
    assert convert([data_file(drive + ".npz"), bag, "--truth", truth, "--quiet"]) == 0
    run_bag(bag, CONFIG, run)
    return drive, judge(bag, run)


def test_the_comparison_is_the_known_one(judged):
    drive, judgement = judged
    frames, dead_reckoning = FACTS[drive]
    assert judgement.slam.matched == frames and judgement.slam.body == "left camera"
    assert judgement.dead_reckoning.ate == pytest.approx(dead_reckoning, abs=0.1)


def test_position_error_after_alignment(judged):
    drive, judgement = judged
    assert judgement.slam.ate <= LIMITS[drive][0]


def test_relative_position_error(judged):
    drive, judgement = judged
    assert judgement.slam.kitti.t_rel <= LIMITS[drive][1]


def test_relative_rotation_error(judged):
    drive, judgement = judged
    assert judgement.slam.kitti.r_rel <= LIMITS[drive][2]
