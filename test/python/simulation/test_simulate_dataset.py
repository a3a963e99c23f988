"""simulate_dataset.py: the format of the real drives, truth that fits, the same drive from the same seed."""

import os

import numpy as np
import pytest
from conftest import script, se3_exp

from vi_ekf_slam.common.geometry import inverse
from vi_ekf_slam.dataset.loader import load_dataset
from vi_ekf_slam.dataset.pose_files import read_pose_file, read_tum

SHORT = ("--duration", "20")


@pytest.fixture
def simulated(tmp_path):
    """Simulates a drive with the given options; returns its path."""
    def run(*options, name="sim.npz"):
        path = str(tmp_path / name)
        result = script("simulate_dataset.py", path, *(options or SHORT))
        assert result.returncode == 0 and result.stderr == "", result.stderr
        return path
    return run


def arrays_of(path):
    with np.load(path) as archive:
        return {key: archive[key] for key in archive.files}


def test_original_edition_has_the_format_of_the_real_files(simulated):
    arrays = arrays_of(simulated())
    assert set(arrays) == {"time_stamps", "linear_velocity", "rotational_velocity", "features", "K", "b", "cam_T_imu"}
    frames, ids = 200, arrays["features"].shape[1]
    assert arrays["time_stamps"].shape == (1, frames) and arrays["time_stamps"][0, 0] == 1317386425.5625
    assert arrays["linear_velocity"].shape == arrays["rotational_velocity"].shape == (3, frames)
    assert arrays["features"].shape == (4, ids, frames)
    assert arrays["K"].shape == (3, 3) and arrays["b"].shape == () and arrays["cam_T_imu"].shape == (4, 4)
    assert all(array.dtype == np.float64 for array in arrays.values())
    np.testing.assert_allclose(arrays["cam_T_imu"][:3, 3], [1.14, -0.31, 0.73], atol=1e-12)
    unseen = arrays["features"] == -1.0
    assert np.array_equal(unseen.all(axis=0), unseen.any(axis=0))
    first = np.argmax(~unseen[0], axis=1)
    assert (~unseen[0]).any(axis=1).all() and (np.diff(first) >= 0).all()  # every id is seen, in the order of ids


def test_both_editions_load_as_the_same_drive(simulated):
    original = load_dataset(simulated(*SHORT, name="a.npz"))
    modern_path = simulated(*SHORT, "--edition", "modern", name="b.npz")
    assert {"angular_velocity", "imu_T_cam"} < set(arrays_of(modern_path))
    modern = load_dataset(modern_path)
    np.testing.assert_allclose(original.cam_T_imu, modern.cam_T_imu, atol=1e-12)
    np.testing.assert_array_equal(original.features, modern.features)
    np.testing.assert_array_equal(original.angular_velocity, modern.angular_velocity)


def test_the_seed_decides_the_drive(simulated):
    first, again = arrays_of(simulated(*SHORT, name="a.npz")), arrays_of(simulated(*SHORT, name="b.npz"))
    other = arrays_of(simulated(*SHORT, "--seed", "2", name="c.npz"))
    for key, array in first.items():
        np.testing.assert_array_equal(array, again[key])
    assert not np.array_equal(first["linear_velocity"], other["linear_velocity"])


def test_the_two_truths_are_one_motion(simulated):
    path = simulated()
    dataset = load_dataset(path)
    _, camera = read_pose_file(path.replace(".npz", "_truth_left_camera.txt"))
    stamps, imu = read_tum(path.replace(".npz", "_truth_imu.tum"))
    np.testing.assert_allclose(stamps, dataset.stamps, atol=1e-6)
    np.testing.assert_allclose(imu[0], np.eye(4), atol=1e-12)
    expected = dataset.cam_T_imu @ imu @ inverse(dataset.cam_T_imu)
    np.testing.assert_allclose(camera, expected, atol=1e-8)
    assert np.linalg.norm(camera[-1, :3, 3]) > 20.0


def test_noise_free_twist_dead_reckons_to_the_truth(simulated):
    quiet = [word for name in ("velocity-sigma", "gyro-sigma", "gyro-bias-min", "gyro-bias-max")
             for word in ("--" + name, "0")]
    path = simulated(*SHORT, *quiet)
    dataset = load_dataset(path)
    _, imu = read_tum(path.replace(".npz", "_truth_imu.tum"))
    pose = np.eye(4)
    for k in range(dataset.frames - 1):
        twist = np.concatenate([dataset.linear_velocity[:, k], dataset.angular_velocity[:, k]])
        pose = pose @ se3_exp((dataset.stamps[k + 1] - dataset.stamps[k]) * twist)
    np.testing.assert_allclose(pose, imu[-1], atol=1e-4)  # a stamp as a double is good to 0.2 us


def test_features_are_the_projected_world_where_nothing_disturbs_them(simulated):
    path = simulated(*SHORT, "--pixel-sigma", "0", "--stale-fraction", "0", "--outlier-fraction", "0",
                     "--moving-objects", "0")
    dataset = load_dataset(path)
    _, imu = read_tum(path.replace(".npz", "_truth_imu.tum"))
    world_T_cam = imu @ inverse(dataset.cam_T_imu)
    fu, cu, fv, cv = dataset.intrinsics[[0, 0, 1, 1], [0, 2, 1, 2]]
    for landmark in range(0, dataset.features.shape[1], 7):
        frames = np.flatnonzero(dataset.seen[landmark])
        left_u, left_v, right_u, _ = dataset.features[:, landmark, frames]
        depth = fu * dataset.baseline / (left_u - right_u)
        points = np.stack([(left_u - cu) / fu * depth, (left_v - cv) / fv * depth, depth, np.ones_like(depth)])
        world = np.einsum("kij,jk->ki", world_T_cam[frames], points)
        np.testing.assert_allclose(world, np.broadcast_to(world[0], world.shape), atol=1e-6)


@pytest.mark.parametrize("option, value, allowed", [
    ("--speed", "-3", "from 0.5 to 40 m/s"), ("--features-max", "many", "from 1 to 2000"),
    ("--imu-rate", "100", "imu-rate"), ("--motion", "process", "duration")])
def test_bad_values_are_named_and_nothing_is_written(tmp_path, option, value, allowed):
    result = script("simulate_dataset.py", tmp_path / "sim.npz", option, value)
    assert result.returncode == 2 and result.stderr.startswith("error: option "), result.stderr
    assert allowed in result.stderr and len(result.stderr.splitlines()) == 1
    assert os.listdir(str(tmp_path)) == []


def test_output_must_be_an_npz_in_a_directory_that_exists(tmp_path):
    assert "ends in .npz" in script("simulate_dataset.py", tmp_path / "sim.bag").stderr
    assert "does not exist" in script("simulate_dataset.py", tmp_path / "no" / "sim.npz").stderr


def test_help_names_every_option_with_its_unit():
    text = script("simulate_dataset.py", "--help").stdout
    for words in ("--gyro-sigma RAD/S", "--stale-fraction", "--ids-return", "(default: 0.5 m/s)"):
        assert words in text
