"""Two frames of /tf_static, connected directly or not."""

import numpy as np
from geometry_msgs.msg import TransformStamped

from vi_ekf_slam.bag.transforms import chain
from vi_ekf_slam.common.geometry import inverse, make_transform

TURN = make_transform(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.zeros(3))


def link(parent, child, x, turned=False):
    message = TransformStamped()
    message.header.frame_id, message.child_frame_id = parent, child
    message.transform.translation.x = x
    message.transform.rotation.z = message.transform.rotation.w = np.sqrt(0.5)
    if not turned:
        message.transform.rotation.z, message.transform.rotation.w = 0.0, 1.0
    return message


def test_a_chain_in_any_direction_with_or_without_leading_slashes():
    links = [link("base_link", "/imu_link", 1.0, turned=True), link("/base_link", "camera", 3.0)]
    base_T_imu, base_T_camera = make_transform(TURN[:3, :3], [1.0, 0, 0]), make_transform(np.eye(3), [3.0, 0, 0])
    assert np.allclose(chain(links, "camera", "imu_link"), inverse(base_T_camera) @ base_T_imu)
    assert np.allclose(chain(links, "/imu_link", "camera"), inverse(base_T_imu) @ base_T_camera)
    assert np.allclose(chain(links, "camera", "camera"), np.eye(4))
    assert chain(links, "camera", "elsewhere") is None


def test_what_is_no_transform_connects_nothing():
    unturned = link("a", "b", 1.0)
    unturned.transform.rotation.w = 0.0
    assert chain([unturned], "a", "b") is None
    assert chain([link("a", "b", float("nan"))], "a", "b") is None
