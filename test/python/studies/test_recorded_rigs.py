"""check_rig.py on recorded rigs, which are sound."""

import argparse
import os

import pytest
from conftest import DATA

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.rig_check.checker import make_report
from vi_ekf_slam.rig_check.finding import GREEN, RED


@pytest.mark.parametrize("name, options", [("images/euroc_mh01", ()), ("images/kitti_2011_09_26_0001", ("--velocity",)),
                                           ("vio_sim/V2_02.npz", ()), ("extra_0001.npz", ("--velocity-sigma", "0.1"))])
def test_no_fault_is_found_in_a_recorded_rig(name, options, tmp_path):
    source = os.path.join(DATA, name)
    if not os.path.exists(source):
        pytest.skip("NOT RUN: %s is not in %s; set VI_EKF_SLAM_DATA to the directory with the drives" % (name, DATA))
    path = str(tmp_path / "drive.bag")
    assert convert([source, path, "--quiet"] + list(options)) == 0
    report = make_report(path, name, argparse.Namespace(remap=[], duration=12.0, imu_noise=None, without_load=True))
    assert report.of_level(RED) == []
    assert {"topics", "stereo"} <= {finding.check for finding in report.of_level(GREEN)}
