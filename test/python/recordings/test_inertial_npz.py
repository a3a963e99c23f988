"""Drives with an accelerometer as an .npz: what is in their bags and beside them."""

import numpy as np
import pytest
import rosbag
import yaml
from conftest import CAM_R_IMU, CAMERA_IN_IMU, data_file

from vi_ekf_slam.bag.converter import main
from vi_ekf_slam.bag.reader import read_reference
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import (make_transform, quaternion_to_rotation, rotation_to_quaternion, so3_exp, so3_log)
from vi_ekf_slam.recordings.inertial_npz import load_inertial_npz
from vi_ekf_slam.recordings.initial_state import covariance_about_map

OFFSET = 1521753106.5
START = so3_exp([0.3, -0.7, 1.9])  # map_R_imu of the state to start from


def covariance(seed=5):
    """(15, 15) with correlations everywhere, in the file's order: rotation in IMU axes, position, velocity, biases."""
    root = np.random.default_rng(seed).normal(size=(15, 15))
    return 1e-4 * (root @ root.T + np.eye(15))


def inertial_drive(**changes):
    """The arrays of a small valid drive: 41 IMU samples, 3 frames of 4 points; a change to None takes a key away."""
    random = np.random.default_rng(3)
    state = np.concatenate([rotation_to_quaternion(START), random.normal(size=12)])
    arrays = {
        "meta": np.array("text"), "t_offset": np.float64(OFFSET), "K": np.array([[450.0, 0, 360], [0, 450, 240], [0, 0, 1]]),
        "baseline": np.float64(0.11), "imu_T_rectleft": make_transform(CAM_R_IMU.T, CAMERA_IN_IMU),
        "image_size": np.array([752, 480]), "gravity": np.array([0.0, 0.0, -9.81]), "gyro_density": np.float64(2e-4),
        "accel_density": np.float64(2e-3), "gyro_walk": np.float64(2e-5), "accel_walk": np.float64(3e-3),
        "imu_rate": np.float64(400.0), "imu_t": 0.0025 * np.arange(41), "imu_gyro": random.normal(size=(41, 3)),
        "imu_accel": random.normal(size=(41, 3)), "cam_t": np.array([0.011, 0.061, 0.1]),
        "frame_ptr": np.array([0, 4, 4, 8]), "id": np.array([3, 5, 8, 9, 3, 5, 8, 4000000000], dtype=np.uint32),
        "uv": random.uniform(20.0, 400.0, (8, 4)), "sigma_q": np.full((8, 4), 64, dtype=np.uint8),
        "truth_t": np.array([0.0, 0.011, 0.061, 0.1]), "truth_q": np.tile(rotation_to_quaternion(START), (4, 1)),
        "truth_p": random.normal(size=(4, 3)), "init_tight": state, "P0_tight": covariance(),
    }
    arrays.update(changes)
    return {key: value for key, value in arrays.items() if value is not None}


@pytest.fixture
def converted(save, tmp_path):
    """Converts a drive; returns the messages by topic."""
    def run(arrays):
        path = str(tmp_path / "out.bag")
        assert main([save(arrays), path, "--quiet"]) == 0
        topics = {}
        with rosbag.Bag(path) as bag:
            for topic, message, stamp in bag.read_messages():
                topics.setdefault(topic, []).append((stamp.to_nsec(), message))
        return topics
    return run


def test_every_sample_and_point_is_in_the_bag_at_its_stamp(converted):
    arrays = inertial_drive()
    topics = converted(arrays)
    assert {topic: len(entries) for topic, entries in topics.items()} == {
        "/tf_static": 1, "/ground_truth/path": 1, "/imu": 41, "/left/camera_info": 3, "/right/camera_info": 3,
        "/features": 3, "/ground_truth/pose": 4}
    for k, (stamp, m) in enumerate(topics["/imu"]):
        assert stamp == m.header.stamp.to_nsec() == 1521753106500000000 + 2500000 * k
        w, a = m.angular_velocity, m.linear_acceleration
        assert [w.x, w.y, w.z] == list(arrays["imu_gyro"][k]) and [a.x, a.y, a.z] == list(arrays["imu_accel"][k])
        assert np.allclose(np.reshape(m.angular_velocity_covariance, (3, 3)), 4e-8 * 400 * np.eye(3))
        assert np.allclose(np.reshape(m.linear_acceleration_covariance, (3, 3)), 4e-6 * 400 * np.eye(3))
        assert m.orientation_covariance[0] == -1.0
    for (stamp, m), rows, milliseconds in zip(topics["/features"], (range(4), (), range(4, 8)), (511, 561, 600)):
        assert stamp == m.header.stamp.to_nsec() == 1521753106000000000 + milliseconds * 1000000
        assert [f.id for f in m.features] == [arrays["id"][row] for row in rows]
        assert [[f.u_left, f.v_left, f.u_right, f.v_right] for f in m.features] == [list(arrays["uv"][row]) for row in rows]


def test_a_features_sigma_is_that_of_both_columns_and_the_mean_row(converted):
    sigmas = np.array([[64, 64, 64, 64]] * 6 + [[64, 128, 64, 128], [128, 64, 64, 64]], dtype=np.uint8)
    last = converted(inertial_drive(sigma_q=sigmas))["/features"][-1][1].features
    assert [f.sigma for f in last] == pytest.approx([1.0, 1.0, np.sqrt(2.0), np.sqrt(2.0)])


def test_pixels_beyond_the_borders_stay_what_they_are_in_a_larger_picture(converted):
    pixels = np.array(inertial_drive()["uv"])
    pixels[2], pixels[5] = [-130.2, -80.5, -146.6, -80.9], [897.3, 566.1, 890.0, 566.0]
    topics = converted(inertial_drive(uv=pixels))
    left, right = (topics["/%s/camera_info" % side][0][1] for side in ("left", "right"))
    assert (left.width, left.height) == (right.width, right.height) == (1045, 648)
    assert [left.P[2], left.P[6]] == [360 + 147, 240 + 81] and right.P[3] == pytest.approx(-450 * 0.11)
    seen = np.array([[f.u_left, f.v_left, f.u_right, f.v_right] for f in topics["/features"][0][1].features])
    assert seen - [147, 81, 147, 81] == pytest.approx(pixels[:4]) and seen.min() >= 0.0


def test_truth_and_extrinsic_are_read_back(converted, tmp_path):
    arrays = inertial_drive()
    converted(arrays)
    reference = read_reference(str(tmp_path / "out.bag"))
    assert np.allclose(np.linalg.inv(reference.cam_T_imu), arrays["imu_T_rectleft"])
    assert np.allclose(reference.truth[1][:, :3, 3], arrays["truth_p"])  # in the world of the file, not from the identity on
    assert np.allclose(reference.truth[1][2, :3, :3], START)


def test_the_noise_is_written_as_a_calibration(converted, tmp_path):
    converted(inertial_drive())
    noise = yaml.safe_load((tmp_path / "out.imu.yaml").read_text())
    assert noise == {"gyroscope_noise_density": 2e-4, "gyroscope_random_walk": 2e-5, "accelerometer_noise_density": 2e-3,
                     "accelerometer_random_walk": 3e-3, "rostopic": "/imu", "update_rate": 400.0}


def test_the_initial_state_is_written_as_it_is_and_its_covariance_about_the_maps_axes(converted, tmp_path):
    arrays = inertial_drive()
    converted(arrays)
    text = (tmp_path / "out.initial_state.yaml").read_text()
    assert text.startswith("stamp: 1521753106.500000000 ")
    state = yaml.safe_load(text)
    assert np.allclose(quaternion_to_rotation(state["orientation"]), START)
    assert np.allclose(np.concatenate([state[key] for key in ("position", "velocity", "gyro_bias", "accelerometer_bias")]),
                       arrays["init_tight"][4:])
    assert np.allclose(np.reshape(state["covariance"], (15, 15)), covariance_about_map(covariance(), START))


def test_the_converted_covariance_is_that_of_samples_drawn_in_the_files_convention():
    """Draw estimates as the file says, and measure the errors as the YAML file says."""
    random, small = np.random.default_rng(11), 1e-2 * covariance()
    errors = random.multivariate_normal(np.zeros(15), small, size=20000)
    truth = [so3_exp(e[:3]) for e in errors[:2000]]
    drawn = np.array([np.concatenate([-e[3:6], so3_log(START @ (START @ r).T), -e[6:]]) for e, r in zip(errors, truth)])
    # R_true = START; R_estimated = START Exp(e): the errors are small, so which of the two turns the axes does not matter.
    expected = covariance_about_map(small, START)
    scale = np.sqrt(np.diag(expected))
    assert np.abs(np.cov(drawn.T) - expected) / np.outer(scale, scale) == pytest.approx(0.0, abs=0.12)


@pytest.mark.parametrize("changes, complaint", [
    ({"imu_t": 0.0025 * np.arange(41)[::-1]}, "imu_t is not increasing"),
    ({"imu_accel": np.zeros((40, 3))}, r"imu_accel has shape \(40, 3\), allowed: 41 x 3"),
    ({"gyro_density": np.float64(0.0)}, "gyro_density is 0, allowed: finite and above 0"),
    ({"frame_ptr": np.array([0, 4, 3, 8])}, "frame_ptr goes from 0 to 8"),
    ({"id": np.arange(8) + 0.5}, "id holds 0.5, allowed: whole numbers"),
    ({"id": np.arange(8, dtype=np.uint64) + np.uint64(2**63)}, r"id holds 9.22337e\+18, allowed: below 2\^53"),
    ({"id": np.arange(8) + 2**53 - 7}, r"id holds 9.0072e\+15, allowed: below 2\^53"),
    ({"image_size": np.array([-5, 1e9])}, r"image_size is -5 x 1e\+09 px, allowed: from 1 to 100000"),
    ({"image_size": np.array([752, 0])}, "image_size is 752 x 0 px"),
    ({"sigma_q": np.zeros((8, 4))}, "sigma_q holds 0, allowed: above 0"),
    ({"gravity": np.array([0.0, 9.81, 0.0])}, "gravity is .*allowed: 0 0 -g"),
    ({"P0_tight": -np.eye(15)}, "P0_tight has the eigenvalue -1"),
    ({"init_tight": np.zeros(16)}, "quaternion of norm 0"),
    ({"gyro_walk": np.float64(1e200)}, r"gyro_walk is 1e\+200 at index \[0\], allowed: within \+-1e\+06 rad/s\^2/sqrt"),
    ({"truth_q": np.ones((4, 4))}, r"truth_q\[0\] has a quaternion of norm 2"),
    ({"truth_p": None}, "key 'truth_p' is missing"),
    ({"imu_T_rectleft": np.diag([1.0, 1, -1, 1])}, "imu_T_rectleft is not a rotation")])
def test_what_is_wrong_is_named(save, changes, complaint):
    path = save(inertial_drive(**changes))
    with pytest.raises(InputError, match=complaint) as refused:
        load_inertial_npz(path, 100.0)
    assert str(refused.value).startswith(path)


def test_nothing_is_written_when_a_drive_is_refused(save, tmp_path):
    assert main([save(inertial_drive(P0_tight=np.zeros((15, 15)))), str(tmp_path / "out.bag"), "--quiet"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["drive.npz"]


@pytest.mark.parametrize("key", ["imu_t", "cam_t", "uv"])
def test_a_key_by_which_the_format_is_known_is_named_where_it_is_missing(save, tmp_path, capfd, key):
    assert main([save(inertial_drive(**{key: None})), str(tmp_path / "out.bag")]) == 2
    assert "key '%s' is missing; the file holds: K, P0_tight, " % key in capfd.readouterr().err


def test_options_that_would_do_nothing_are_refused(save, tmp_path, capfd):
    assert main([save(inertial_drive()), str(tmp_path / "out.bag"), "--truth", "poses.tum"]) == 2
    assert "--truth is given, allowed for an .npz with a velocity and a folder of EuRoC" in capfd.readouterr().err
    assert not (tmp_path / "out.bag").exists()


@pytest.mark.parametrize("name", ["gore", "V1_01", "V2_02"])
def test_the_true_start_of_a_simulated_stream_is_within_the_covariance(name):
    """And only so with the rotation's block about the map's axes: there the heading is known ten times better."""
    path = data_file("vio_sim/%s.npz" % name)
    state = load_inertial_npz(path, 4096.0).initial_state
    with np.load(path) as arrays:
        true = arrays["init_truth"]
    rotation = so3_log(quaternion_to_rotation(true[:4]) @ state.world_T_imu[:3, :3].T)
    error = np.concatenate([true[4:7] - state.world_T_imu[:3, 3], rotation, true[7:10] - state.velocity,
                            true[10:13] - state.gyro_bias, true[13:] - state.accelerometer_bias])
    assert error @ np.linalg.solve(state.covariance, error) < 37.7  # 99.9 % of a chi-square variable of 15 dof
    assert np.sqrt(np.diag(state.covariance)[3:6]) == pytest.approx([1e-3, 1e-3, 1e-4], rel=0.01)
