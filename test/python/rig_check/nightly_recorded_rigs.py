"""Recorded rigs that are broken afterwards: the fault is named first. Takes minutes: scripts/nightly.sh rigs."""

import argparse
import os

import breaking
import numpy as np
import pytest
import rigs
from conftest import DATA

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.common.geometry import inverse, make_transform, so3_exp
from vi_ekf_slam.rig_check.checker import make_report
from vi_ekf_slam.rig_check.finding import RED, YELLOW

SPAN = 14.0  # s of each
SOURCES = {"euroc": ("images/euroc_mh01", ()), "kitti": ("images/kitti_2011_09_26_0001", ("--velocity",)),
           "simulator": ("vio_sim/V2_02.npz", ())}
PICTURES = ("/left/image", "/right/image")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Entries of a recorded rig by its name, read once."""
    held = {}

    def entries(name):
        if name not in held:
            source, options = SOURCES[name]
            if not os.path.exists(os.path.join(DATA, source)):
                pytest.skip("NOT RUN: %s is not in %s; set VI_EKF_SLAM_DATA to the directory with the drives" % (source, DATA))
            path = str(tmp_path_factory.mktemp(name) / "drive.bag")
            assert convert([os.path.join(DATA, source), path, "--quiet"] + list(options)) == 0
            held[name] = rigs.read(path, SPAN)
        return rigs.copies(held[name])
    return entries


def exchange_pictures(entries):
    for entry in rigs.of(entries, *PICTURES):
        entry[0] = entry[0].replace("left", "?").replace("right", "left").replace("?", "right")
    return entries


def unrectified_info(left, right):
    for info in (left, right):
        info.K, info.D, info.R = [info.P[k] for k in (0, 1, 2, 4, 5, 6, 8, 9, 10)], [0.0] * 5, np.eye(3).ravel().tolist()


def inverted(entries):
    return breaking.extrinsic(entries, inverse(breaking.imu_T_left(entries)))


def turned(entries):
    return breaking.extrinsic(entries, breaking.imu_T_left(entries) @ make_transform(so3_exp([0.0, 0.15, 0.1]), np.zeros(3)))


def later(seconds, *topics):
    return lambda entries: rigs.shift_stamps(entries, seconds, *topics)


CASES = [
    ("euroc", RED, "left and right pictures are exchanged", exchange_pictures),
    ("euroc", RED, "matched points lie in different rows", lambda e: breaking.infos(e, unrectified_info)),
    ("euroc", RED, "accelerations are in g", lambda e: breaking.accelerations(e, lambda a: a / 9.80665)),
    ("euroc", RED, "the gyro is in deg/s", lambda e: breaking.gyro(e, np.degrees)),
    ("euroc", RED, "an axis of the gyro has the wrong sign", lambda e: breaking.gyro(e, lambda w: w * [1, 1, -1])),
    ("euroc", RED, "it looks inverted", inverted),
    ("euroc", RED, "imu -> camera is off by 10", turned),
    ("euroc", RED, "the camera's stamps are 2", later(0.023, *PICTURES)),
    ("euroc", RED, "left and right pictures are not pairs", later(0.012, "/right/image")),
    ("euroc", RED, "right pictures are black", lambda e: rigs.change_pictures(e, "right", lambda i: i // 30)),
    ("euroc", RED, "not equally sharp", lambda e: rigs.change_pictures(e, "left", rigs.blurred)),
    ("kitti", RED, "left and right pictures are exchanged", exchange_pictures),
    ("kitti", RED, "the scale of the baseline does not fit the velocity", lambda e: breaking.infos(e, breaking.scale_baseline(1.2))),
    ("kitti", RED, "the camera does not travel where the velocity points", breaking.backwards),
    ("kitti", RED, "matched points lie in different rows", lambda e: rigs.change_pictures(e, "left", lambda i: np.roll(i, 5, 0))),
    ("simulator", RED, "disparity has the wrong sign", lambda e: breaking.features(e, breaking.exchanged)),
    ("simulator", RED, "the gyro is in deg/s", lambda e: breaking.gyro(e, np.degrees)),
    ("simulator", RED, "it looks inverted", inverted),
    ("simulator", RED, "the camera's stamps are", later(0.03, "/features")),
    ("simulator", RED, "gravity is missing", lambda e: breaking.accelerations(e, lambda a: 0.02 * a)),
    ("simulator", YELLOW, "stutters", breaking.burst),
]


@pytest.mark.parametrize("name, level, words, breaks", CASES, ids=["%s: %s" % (case[0], case[2]) for case in CASES])
def test_the_fault_is_named_first(name, level, words, breaks, recorded, tmp_path):
    path = rigs.write(str(tmp_path / "broken.bag"), breaks(recorded(name)))
    report = make_report(path, name, argparse.Namespace(remap=[], duration=0.0, imu_noise=None, without_load=True))
    assert report.first.level == level and words in report.first.text, report.findings
