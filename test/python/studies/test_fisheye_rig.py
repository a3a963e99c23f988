"""A rig with fisheye lenses, drawn: what the front end follows beyond the borders of a rectified picture is used, and told apart by how
precise it is."""

import numpy as np
import rosbag

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.simulation.pictures.lens import Fisheye
from vi_ekf_slam.simulation.simulator import main as simulate


def test_a_fisheye_rig_is_followed_with_all_that_it_sees(evaluated, tmp_path):
    folder, bag, tracks = (str(tmp_path / name) for name in ("room", "room.bag", "tracks.bag"))
    assert simulate([folder, "--images", "--scene", "room", "--lens", "fisheye", "--duration", "12", "--laps", "0.6", "--quiet"]) == 0
    assert convert([folder, bag, "--quiet"]) == 0
    data = evaluated(bag, str(tmp_path / "run"), "--save-features", tracks)
    with rosbag.Bag(tracks) as source:
        features = np.array([(f.u_left, f.v_left, f.sigma) for _, message, _ in source.read_messages("/features")
                             for f in message.features])
    outside = ((features[:, :2] < 0.0) | (features[:, :2] > Fisheye.size[0] - 1)).any(axis=1)
    from_middle = np.linalg.norm(features[:, :2] - 0.5 * (Fisheye.size[0] - 1), axis=1) / Fisheye.focal_length  # tangent
    print("ATE %.4f m, %.0f %% of the features beyond the rectified picture" % (
        data["slam"]["ate_yaw_aligned_m"], 100.0 * outside.mean()))
    assert data["slam"]["ate_yaw_aligned_m"] < 0.01
    assert outside.mean() > 0.05 and from_middle.max() < 2.1
    middle, edge = (np.median(features[chosen, 2]) for chosen in (from_middle < 0.3, from_middle > 1.5))
    assert edge > 2.0 * middle
