"""With few, short, missing or mostly wrong features the default configuration is never worse than dead reckoning."""

import functools
import os

import pytest
from conftest import ROOT, data_file

from vi_ekf_slam.bag import degrader
from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.evaluation.offline_run import judge, run_bag
from vi_ekf_slam.simulation.simulator import main as simulate

CONFIG = os.path.join(ROOT, "config", "default.yaml")
FACTOR = 1.1  # of the ATE of dead reckoning on that very bag
SHARE_OF_WAY = 0.005

GOOD = ("--velocity-sigma", "0.1", "--gyro-sigma", "0.01")
CUT = ("--longest", "6", "--drop-last", "0.4")
DRIVES = ("0027", "0034")
CASES = {
    "every 10th track": ("--good-twist", "--every", "10"),
    "every 20th track": ("--good-twist", "--every", "20"),
    "every 10th track, ends cut": ("--good-twist", "--every", "10", *CUT),
    "every 20th track, ends cut": ("--good-twist", "--every", "20", *CUT),
    "ends cut": ("--good-twist", *CUT),
    "30 s without features": ("--blackout", "40", "30"),
    "30 s without features, good twist": ("--good-twist", "--blackout", "40", "30"),
    "every 10th track, own twist": ("--every", "10"),
    "every 20th track, own twist": ("--every", "20"),
    "60 % traffic": ("--traffic", "0.6"),
    "60 % traffic, good twist": ("--good-twist", "--traffic", "0.6"),
    "60 % traffic, every 5th track, good twist": ("--good-twist", "--traffic", "0.6", "--every", "5"),
    "no features": ("--blackout", "0", "1000"),
}

# A straight road full of cars: 57 to 66 % of the features ride on them (seeds 1 and 2), in every fourth frame all.
MOTORWAY = ("--block-length", "2000", "--speed", "30", "--duration", "60", "--moving-objects", "50",
            "--features-max", "60", "--features-min", "10", "--track-median", "500", "--track-max", "500",
            "--stale-fraction", "0.05")
TWISTS = {"noisy twist": (), "good twist": GOOD + ("--gyro-bias-min", "0", "--gyro-bias-max", "0")}

@functools.lru_cache(maxsize=None)  # reading takes as long as a run
def drive_with_truth(npz, truth):
    return degrader.load_drive(npz, truth)


def require_no_worse_than_dead_reckoning(bag, folder):
    warnings = run_bag(bag, CONFIG, str(folder / "run"))
    assert "as the pictures do" not in warnings  # nothing is wrong with gyro and velocity
    judgement = judge(bag, str(folder / "run"))
    limit = max(FACTOR * judgement.dead_reckoning.ate, SHARE_OF_WAY * judgement.way)
    print("ATE %.3f m, dead reckoning %.3f m, way %.0f m, limit %.3f m"
          % (judgement.slam.ate, judgement.dead_reckoning.ate, judgement.way, limit))
    assert judgement.slam.matched > 100
    assert judgement.slam.ate <= limit
    return judgement


@pytest.mark.parametrize("drive, dead_reckoning", [("extra_0036", 0.16), ("extra_0095", 0.70)])
def test_with_a_good_ins(drive, dead_reckoning, tmp_path):
    bag, truth = str(tmp_path / "drive.bag"), data_file(drive + "_truth_left_camera.txt")
    assert convert([data_file(drive + ".npz"), bag, "--truth", truth, "--quiet", *GOOD]) == 0
    judgement = require_no_worse_than_dead_reckoning(bag, tmp_path)
    assert judgement.dead_reckoning.ate == pytest.approx(dead_reckoning, abs=0.01)


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("case", CASES)
def test_with_degraded_features(case, drive, tmp_path):
    bag, truth = str(tmp_path / "drive.bag"), data_file(drive + "_truth_left_camera.txt")
    npz = data_file(drive + ".npz")
    options = degrader.make_parser().parse_args([npz, bag, "--truth", truth, "--quiet", *CASES[case]])
    degrader.write(options, drive_with_truth(npz, truth))
    require_no_worse_than_dead_reckoning(bag, tmp_path)


@pytest.mark.parametrize("twist", TWISTS)
@pytest.mark.parametrize("seed", "123")
def test_in_simulated_traffic(seed, twist, tmp_path):
    npz, bag = str(tmp_path / "drive.npz"), str(tmp_path / "drive.bag")
    assert simulate([npz, "--quiet", "--seed", seed, *MOTORWAY, *TWISTS[twist]]) == 0
    sigmas = GOOD if twist == "good twist" else ()
    truth = str(tmp_path / "drive_truth_left_camera.txt")
    assert convert([npz, bag, "--truth", truth, "--quiet", *sigmas]) == 0
    require_no_worse_than_dead_reckoning(bag, tmp_path)
