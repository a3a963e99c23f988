"""Recorded drives with pictures, from the pictures to the trajectory, by the package's own front end and start."""

import os

import numpy as np
from conftest import data_file

from vi_ekf_slam.bag.converter import main as convert

REST_S = 14.0  # MH_01 ends with it


def test_a_hand_held_rig_starts_by_itself_and_stays_where_it_is_put_down(evaluated, tmp_path):
    folder = os.path.dirname(data_file("images/euroc_mh01/truth_imu.tum"))
    bag = str(tmp_path / "mh01.bag")
    assert convert([folder, bag, "--quiet"]) == 0
    slam = evaluated(bag, str(tmp_path / "run"))["slam"]
    trajectory = np.loadtxt(str(tmp_path / "run" / "trajectory.tum"))  # (N, 8): stamp, position, quaternion
    pictures = np.genfromtxt(os.path.join(folder, "mav0", "cam0", "data.csv"), delimiter=",", usecols=0, comments="#", dtype=np.int64)
    first_pose = trajectory[0, 0] - 1e-9 * pictures[0]
    rest = trajectory[trajectory[:, 0] > trajectory[-1, 0] - REST_S, 1:4]
    drift = np.linalg.norm(rest[-1] - rest[0])
    print("MH_01: ATE (yaw and position) %.1f mm, first pose after %.2f s, %.1f mm of drift in %g s at rest, never more than %.1f mm"
          % (1e3 * slam["ate_yaw_aligned_m"], first_pose, 1e3 * drift, REST_S, 1e3 * np.linalg.norm(rest - rest[0], axis=1).max()))
    assert slam["ate_yaw_aligned_m"] < 0.0075
    assert first_pose < 2.0
    assert drift < 0.003


def test_a_car_is_followed_by_its_pictures_alone_and_better_with_its_velocity(evaluated, tmp_path):
    folder = os.path.dirname(data_file("images/kitti_2011_09_26_0001/truth_left_camera.txt"))
    bag = str(tmp_path / "0001.bag")
    assert convert([folder, bag, "--velocity", "--quiet"]) == 0
    t_rel = {}
    for name, options in (("frames alone", ("--imu", "", "--velocity", "")), ("gyro", ("--velocity", "")), ("gyro and velocity", ())):
        slam = evaluated(bag, str(tmp_path / name.replace(" ", "_")), *options)["slam"]
        t_rel[name] = slam["t_rel_percent"]
        print("0001, %s: ATE %.3f m, t_rel %.2f %%" % (name, slam["ate_m"], t_rel[name]))
    assert t_rel["frames alone"] < 1.2
    assert t_rel["gyro and velocity"] < 1.0
