"""A recorded rig told that its camera is turned by 1 deg and its clock shifted by 15 ms: estimated with the motion, both are found,
and the trajectory is nearly as good as with the right ones."""

import os

import numpy as np
import pytest
import yaml
from conftest import DATA
from scipy.spatial.transform import Rotation

from vi_ekf_slam.bag.converter import main as convert

SOURCE = os.path.join(DATA, "images", "euroc_mh01")
AXIS = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)


@pytest.mark.skipif(not os.path.exists(SOURCE),
                    reason="NOT RUN: images/euroc_mh01 is not in %s; set VI_EKF_SLAM_DATA to the directory with the drives" % DATA)
def test_a_wrong_extrinsic_and_clock_are_found(evaluated, tmp_path):
    images, tracks = str(tmp_path / "images.bag"), str(tmp_path / "tracks.bag")
    assert convert([SOURCE, images, "--quiet"]) == 0

    def ate(bag, name, calibration, *options):
        config = tmp_path / (name + ".yaml")
        config.write_text(yaml.safe_dump({"calibration": calibration}))
        return evaluated(bag, str(tmp_path / name), "--config", str(config), *options,
                         truth=("--truth", os.path.join(SOURCE, "truth_imu.tum")))["slam"]["ate_yaw_aligned_m"]

    kept = str(tmp_path / "rig.yaml")
    right = ate(images, "right", {"rotation_sigma": 0.001, "time_offset_sigma": 0.001}, "--save-features", tracks,
                "--save-calibration", kept)
    with open(kept, encoding="utf-8") as stream:
        rig = yaml.safe_load(stream)
    wrong = dict(rig, time_offset=rig["time_offset"] + 0.015, time_offset_sigma=0.015, rotation_sigma=[float(np.deg2rad(1.0))] * 3,
                 orientation=[float(x) for x in (Rotation.from_rotvec(np.deg2rad(1.0) * AXIS)
                                                 * Rotation.from_quat(rig["orientation"])).as_quat()])
    (tmp_path / "wrong.yaml").write_text(yaml.safe_dump(wrong))
    found = str(tmp_path / "found.yaml")
    estimated = ate(tracks, "estimated", {"file": "wrong.yaml", "rotation_sigma": 0.02, "time_offset_sigma": 0.02},
                    "--save-calibration", found)
    taken = ate(tracks, "taken", {"file": "wrong.yaml"})
    print("ATE %.4f m, with the wrong calibration %.4f m, estimated %.4f m" % (right, taken, estimated))
    assert estimated < 1.3 * right
    assert taken > 2.0 * right  # it matters
    with open(found, encoding="utf-8") as stream:
        estimate = yaml.safe_load(stream)
    left = Rotation.from_quat(estimate["orientation"]) * Rotation.from_quat(rig["orientation"]).inv()
    assert np.rad2deg(left.magnitude()) < 0.2 and abs(estimate["time_offset"] - rig["time_offset"]) < 0.003
