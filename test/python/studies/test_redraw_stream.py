"""scripts/studies/redraw_stream.py: noise of the same size about the same truth."""

import importlib.util
import os

import numpy as np
import pytest
from conftest import ROOT, data_file


@pytest.fixture(scope="module")
def redraw():
    spec = importlib.util.spec_from_file_location("redraw", os.path.join(ROOT, "scripts", "studies", "redraw_stream.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def stream():
    with np.load(data_file("vio_sim/V2_02.npz"), allow_pickle=False) as npz:
        return {key: npz[key] for key in npz.files}


def test_pixels_have_the_noise_that_the_stream_has(redraw, stream):
    truth, sigma = redraw.true_pixels(stream), stream["sigma_q"] / redraw.SIGMA_STEPS
    again = redraw.redrawn(stream, 1, 0.0)
    for pixels in (stream["uv"], again["uv"]):
        error = (pixels - truth) / sigma
        np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=0.01)
        np.testing.assert_allclose(error.std(axis=0), 1.0, atol=0.01)
    np.testing.assert_allclose(((again["uv"] - stream["uv"]) / sigma).std(axis=0), np.sqrt(2.0), atol=0.01)
    assert (redraw.redrawn(stream, 1, 0.0)["uv"] == again["uv"]).all()
    assert (again["imu_gyro"] == stream["imu_gyro"]).all()


def test_the_imu_gets_the_noise_that_its_densities_say(redraw, stream):
    again = redraw.redrawn(stream, 2, 2.0)
    for samples, density, walk in redraw.IMU:
        added = (again[samples] - stream[samples]).astype(float)
        white = np.diff(added, axis=0).std() / np.sqrt(2.0)
        assert white == pytest.approx(2.0 * stream[density] * np.sqrt(stream["imu_rate"]), rel=0.01)
        assert again[density] == pytest.approx(np.sqrt(5.0) * stream[density])
        assert again[walk] == pytest.approx(np.sqrt(5.0) * stream[walk])


def test_an_output_that_cannot_be_is_refused_before_anything_is_drawn(redraw, tmp_path, capsys):
    stream = tmp_path / "stream.npz"
    np.savez(stream, imu_rate=200.0)
    before, nowhere = stream.read_bytes(), str(tmp_path / "new" / "stream.npz")
    assert redraw.main([str(stream), nowhere]) == 2
    assert capsys.readouterr().err == "error: %s: the directory %s does not exist\n" % (nowhere, tmp_path / "new")
    assert redraw.main([str(stream), str(stream)]) == 2 and stream.read_bytes() == before
    assert capsys.readouterr().err == "error: %s: is the input itself\n" % stream


@pytest.mark.parametrize("option, value", [("--seed", "-1"), ("--imu-noise", "nan"), ("--imu-noise", "-2")])
def test_options_out_of_range_are_named(redraw, tmp_path, capsys, option, value):
    assert redraw.main([str(tmp_path / "stream.npz"), str(tmp_path / "new.npz"), option, value]) == 2
    assert capsys.readouterr().err == "error: %s is %s, allowed: 0 or more\n" % (option, value)
