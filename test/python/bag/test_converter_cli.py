"""The command line of dataset_to_bag.py: one error line, status 2, no traceback; and --info."""

import os

import numpy as np
import pytest
from conftest import drive, script


def refused(process, *words):
    """One line `error: ...` on stderr that holds all words, status 2, nothing on stdout."""
    lines = process.stderr.splitlines()
    assert process.returncode == 2 and len(lines) == 1 and lines[0].startswith("error: "), process.stderr
    for word in words:
        assert str(word) in lines[0]
    assert process.stdout == ""


def test_success_reports_what_was_repaired(save, tmp_path):
    features = drive()["features"]
    features[:, :, 6] = features[:, :, 5]
    features[1, 7, 2] = -1.0
    result = script("dataset_to_bag.py", save(drive(features=features)), tmp_path / "out.bag")
    assert result.returncode == 0 and result.stderr == "", result.stderr
    assert "stale frames: 1 repaired, 11 tracks given a new id" in result.stdout
    assert "1 observations rejected" in result.stdout
    assert "cam_T_imu, repaired" in result.stdout and "camera's position in IMU axes" in result.stdout
    assert "42 messages" in result.stdout


def test_quiet_says_nothing(save, tmp_path):
    result = script("dataset_to_bag.py", save(drive()), tmp_path / "out.bag", "--quiet")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


def test_options_may_stand_between_the_files(save, tmp_path):
    result = script("dataset_to_bag.py", save(drive()), "--keep-stale", tmp_path / "out.bag")
    assert result.returncode == 0 and (tmp_path / "out.bag").exists(), result.stderr


def test_a_malformed_drive(save, tmp_path):
    source = save(drive(features=None))
    refused(script("dataset_to_bag.py", source, tmp_path / "out.bag"), source, "features", "dead reckoning")
    assert os.listdir(str(tmp_path)) == ["drive.npz"]


@pytest.mark.parametrize("option, value", [
    ("--gyro-sigma", "0"), ("--gyro-sigma", "-1"), ("--velocity-sigma", "nan"), ("--velocity-sigma", "inf"),
    ("--max-memory-mb", "0")])
def test_options_out_of_range(save, tmp_path, option, value):
    refused(script("dataset_to_bag.py", save(drive()), tmp_path / "out.bag", option, value), option, value, "above 0")


@pytest.mark.parametrize("option", ["--velocity-sigma", "--gyro-sigma", "--velocity-bias-sigma", "--gyro-bias-sigma"])
@pytest.mark.parametrize("value", ["1e200", "1e-200"])
def test_sigmas_whose_square_is_no_number_above_0(save, tmp_path, option, value):
    refused(script("dataset_to_bag.py", save(drive()), tmp_path / "out.bag", option, value), option, "allowed: from 1e-12 to 1000")


def test_a_second_drive_is_not_replaced(save, tmp_path):
    """As `dataset_to_bag.py 00*.npz` would."""
    first, second = save(drive(), "0027.npz"), save(drive(), "0034.npz")
    before = open(second, "rb").read()
    for name, options in (("dataset_to_bag.py", ()), ("degraded_bag.py", ("--truth", "none.txt"))):
        refused(script(name, first, second, *options), second, "allowed: a name that ends in .bag")
    assert open(second, "rb").read() == before


def test_outputs_that_cannot_be(save, tmp_path):
    source = save(drive())
    folder = tmp_path / "none"
    refused(script("dataset_to_bag.py", source, folder / "out.bag"), folder, "does not exist")
    refused(script("dataset_to_bag.py", source, tmp_path), tmp_path, "not a regular file")
    refused(script("dataset_to_bag.py", source, os.devnull), os.devnull, "not a regular file")
    before = open(source, "rb").read()
    refused(script("dataset_to_bag.py", source, source), "the input itself")
    assert open(source, "rb").read() == before
    refused(script("dataset_to_bag.py", source), "OUT.bag is missing")


def test_info_writes_nothing(save, tmp_path):
    arrays = drive(linear_velocity=np.tile([[5.0], [0.0], [0.0]], 8))
    result = script("dataset_to_bag.py", "--info", save(arrays))
    assert result.returncode == 0
    for line in ("drive: drive", "frames: 8 in 0.700 s, 10.00 Hz", "distance: 3.5 m by dead reckoning",
                 "features: 11 to 12 a frame, median 11", "tracks: 12, 3 to 8 frames long, median 8",
                 "stale frames: 0"):
        assert line in result.stdout
    assert os.listdir(str(tmp_path)) == ["drive.npz"]
