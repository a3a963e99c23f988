"""Real drives through the whole chain, dataset_to_bag.py -> run_bag -> plot_run.py, against the known errors of dead
reckoning. This pins down conversion, frames and integration at once."""

import os
import re
import subprocess

import pytest
from conftest import ROOT, data_file, program


@pytest.mark.parametrize("name, reading, ate", [
    ("0027", "repaired", 15.75), ("0027", "given", 16.36), ("0034", "repaired", 53.65), ("0034", "given", 52.83)])
def test_dead_reckoning_has_the_known_error(script, tmp_path, name, reading, ate):
    dataset, truth = data_file(name + ".npz"), data_file(name + "_truth_left_camera.txt")
    bag, run = str(tmp_path / "drive.bag"), str(tmp_path / "run")
    done = script("dataset_to_bag.py", dataset, bag, "--extrinsic", reading, "--truth", truth)
    assert done.returncode == 0, done.stderr
    config = os.path.join(ROOT, "config", "dead_reckoning.yaml")
    subprocess.run([program("run_bag"), bag, "--config", config, "--output", run, "--quiet"], check=True, timeout=120)
    printed = script("plot_run.py", run, "--bag", bag).stdout
    figure = re.search(r"^dead reckoning: ATE (\S+) m \(left camera", printed, re.MULTILINE)
    assert figure and float(figure.group(1)) == pytest.approx(ate, rel=0.02), printed
