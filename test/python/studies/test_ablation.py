"""What scripts/studies/ablation.py runs exists, and its tables say what was found."""

import importlib.util
import os

import pytest
from conftest import ROOT

from vi_ekf_slam.common.yaml_file import read_mapping


@pytest.fixture
def ablation():
    spec = importlib.util.spec_from_file_location("ablation", os.path.join(ROOT, "scripts", "studies", "ablation.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def result(ablation, ate, dead_reckoning=2.0, way=100.0):
    limit = max(ablation.WORSE * dead_reckoning, ablation.SMALL * way)
    return ablation.Result(ablation.Errors(ate, 1.5, 0.5), ablation.Errors(dead_reckoning, 4.0, 1.0), limit)


def test_every_row_changes_keys_that_there_are(ablation):
    known = {}
    for name in ("default", "expert", "paper"):
        known = ablation.changed(known, read_mapping(os.path.join(ROOT, "config", name + ".yaml")))
    ablation.check_keys(ablation.ROWS, known)


def test_a_key_that_is_none_is_named_with_its_row_before_anything_runs(ablation, capsys, tmp_path):
    for changes, key in (({"invariant": {"gate": 3.0, "no_such": 1}}, "invariant.no_such"), ({"no": 1}, "no"),
                         ({"estimator": {"deep": 1}}, "estimator.deep")):
        ablation.ROWS = ablation.ROWS[:1] + (ablation.Row("it", (), changes),)
        assert ablation.main([str(tmp_path / "no_data"), str(tmp_path / "out")]) == 2
        assert "row 'it': there is no configuration key '%s'" % key in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_fourteen_drives_have_their_sensors_noise(ablation):
    assert len(ablation.DRIVES) == len({d.stem for d in ablation.DRIVES}) == 14
    for drive in ablation.DRIVES:
        assert bool(drive.options) == (drive.group == "clean") == (drive.stem.startswith("extra") and "noisy" not in drive.stem)


def test_groups_have_their_means_and_lost_drives_are_counted(ablation):
    drives = ablation.choose(ablation.DRIVES, ["recorded", "0001", "0001_noisy"], "drive")
    rows = (ablation.Row("full", (), {}), ablation.Row("less", (), {}))
    results = {(row.name, drive.name): result(ablation, 1.0) for row in rows for drive in drives}
    results["full", "0034"] = result(ablation, 2.0)
    results["less", "0034"] = result(ablation, 2.3)             # more than 1.1 times dead reckoning
    results["less", "0001"] = result(ablation, 2.3, way=500.0)  # but less than 0.5 % of the way
    results["less", "0001_noisy"] = "it broke"
    header, lines = ablation.table(results, "ate", drives, rows)
    assert header == ["", "0027", "0034", "0001", "0001 noisy", "mean recorded", "mean clean", "mean noisy",
                      "beyond the limit"]
    assert lines == [["dead reckoning", "2.00", "2.00", "2.00", "2.00", "2.00", "2.00", "2.00", ""],
                     ["full", "1.00", "2.00", "1.00", "1.00", "1.50", "1.00", "1.00", "0"],
                     ["less", "1.00", "2.30", "2.30", "failed", "1.65", "2.30", "-", "2"]]
    header, lines = ablation.table(results, "t_rel", drives, rows)
    assert header[-1] == "mean noisy" and lines[1][1:] == ["1.50"] * 7


def test_what_is_asked_for_must_exist(ablation):
    assert [d.name for d in ablation.choose(ablation.DRIVES, ["noisy"], "drive")][0] == "0001_noisy"
    assert [d.name for d in ablation.choose(ablation.DRIVES, ["extra_0009", "0027"], "drive")] == ["0027", "0009"]
    with pytest.raises(ablation.InputError, match="there is no drive '0022'"):
        ablation.choose(ablation.DRIVES, ["0022"], "drive")
    with pytest.raises(ablation.InputError, match="there is no row 'nothing'"):
        ablation.choose(ablation.ROWS, ["full", "nothing"], "row")


def test_a_folder_that_is_none_is_one_error(ablation, capsys, tmp_path):
    missing = tmp_path / "no_data"
    assert ablation.main([str(missing), str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err == "error: %s: is not a directory, allowed: one that holds the drives\n" % missing
