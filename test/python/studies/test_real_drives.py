"""Real drives through the whole chain, dataset_to_bag.py -> run_bag -> plot.py run and evaluate.py, against the known
errors of dead reckoning. This pins down conversion, frames and integration at once."""

import json
import os
import re
import subprocess

import pytest
from conftest import HANG_S, ROOT, data_file, program, script


# ATE in m, t_rel in %, r_rel in deg/100 m.
@pytest.mark.parametrize("name, reading, ate, t_rel, r_rel", [
    ("0027", "repaired", 15.75, 8.19, 6.21), ("0034", "given", 52.83, 23.38, 11.67)])  # test_metrics.py has the other two
def test_dead_reckoning_has_the_known_error(tmp_path, name, reading, ate, t_rel, r_rel):
    dataset, truth = data_file(name + ".npz"), data_file(name + "_truth_left_camera.txt")
    bag, run = str(tmp_path / "drive.bag"), str(tmp_path / "run")
    done = script("dataset_to_bag.py", dataset, bag, "--extrinsic", reading, "--truth", truth)
    assert done.returncode == 0, done.stderr
    config = os.path.join(ROOT, "config", "dead_reckoning.yaml")
    subprocess.run([program("run_bag"), bag, "--config", config, "--output", run, "--quiet"], check=True, timeout=HANG_S)
    printed = script("plot.py", "run", run, "--bag", bag).stdout
    figure = re.search(r"^dead reckoning: ATE (\S+) m \(left camera", printed, re.MULTILINE)
    assert figure and float(figure.group(1)) == pytest.approx(ate, rel=0.02), printed

    done = script("evaluate.py", run, "--bag", bag, "--no-plots")
    assert done.returncode == 0, done.stderr
    with open(os.path.join(run, "evaluation.json"), encoding="utf-8") as stream:
        errors = json.load(stream)["dead_reckoning"]
    assert errors["body"] == "left camera"
    assert errors["ate_m"] == pytest.approx(ate, abs=0.0051)
    assert errors["t_rel_percent"] == pytest.approx(t_rel, abs=0.0051)
    assert errors["r_rel_deg_per_100m"] == pytest.approx(r_rel, abs=0.0051)
    row = re.search(r"^ATE, aligned +m +(\S+) ", done.stdout, re.MULTILINE)
    assert row and float(row.group(1)) == pytest.approx(ate, abs=0.0051), done.stdout
