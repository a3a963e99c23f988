"""Where run_bag may write, and that nothing which it reads is written over."""

import os
import shutil
import subprocess

import pytest
from conftest import HANG_S, program


def run_bag(bag, output, *options):
    return subprocess.run([program("run_bag"), bag, "--output", str(output), "--quiet", *map(str, options)], stdout=subprocess.DEVNULL,
                          stderr=subprocess.PIPE, universal_newlines=True, timeout=HANG_S, check=False)


def content(path):
    with open(str(path), "rb") as stream:
        return stream.read()


@pytest.mark.parametrize("option", ["--save-features", "--save-calibration"])
@pytest.mark.parametrize("linked", [False, True])
def test_the_bag_that_is_read_is_not_written_over(bag, tmp_path, option, linked):
    output, before = bag, content(bag)
    if linked:
        output = tmp_path / "link.bag"
        os.symlink(bag, str(output))
    done = run_bag(bag, tmp_path / "out", option, output)
    assert done.returncode == 1 and "%s would write over %s, which is read" % (option, bag) in done.stderr
    assert content(bag) == before and not (tmp_path / "out").exists()


def test_neither_is_the_configuration(bag, tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("calibration:\n  rotation_sigma: 0.01\n")
    done = run_bag(bag, tmp_path / "out", "--config", config, "--save-calibration", config)
    assert done.returncode == 1 and "--save-calibration would write over %s" % config in done.stderr


def test_neither_is_a_drive_of_the_name_of_the_map(bag, tmp_path):
    drive = shutil.copy(bag, str(tmp_path / "map.bag"))
    done = run_bag(drive, tmp_path, "--save-map")
    assert done.returncode == 1 and "--save-map would write over %s" % drive in done.stderr
    assert content(drive) == content(bag)


def test_a_map_whose_place_is_not_found_is_kept(bag, tmp_path):
    run_bag(bag, tmp_path / "run", "--save-map")
    path = tmp_path / "run" / "map.bag"
    before = content(path)
    done = run_bag(bag, tmp_path / "run", "--load-map", path, "--save-map")
    assert "the place in %s was not found" % path in done.stderr, done.stderr
    assert done.returncode == 2 and "the map of this run was not saved" in done.stderr
    assert content(path) == before
    assert run_bag(bag, tmp_path / "other", "--load-map", path, "--save-map").returncode == 0
    assert (tmp_path / "other" / "map.bag").exists()


@pytest.mark.parametrize("option", ["--save-features", "--save-calibration"])
def test_a_folder_that_is_missing_is_named_before_the_run(bag, tmp_path, option):
    path = tmp_path / "none" / "file"
    done = run_bag(bag, tmp_path / "out", option, path)
    assert done.returncode == 1 and "%s is %s, allowed: a file in a folder that exists; %s does not" % (option, path, path.parent) in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_calibration_may_go_into_the_output(bag, tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text("calibration:\n  rotation_sigma: 0.01\n")
    path = tmp_path / "out" / "calibration.yaml"
    done = run_bag(bag, tmp_path / "out", "--config", config, "--save-calibration", path)
    assert done.returncode == 0 and path.exists(), done.stderr
