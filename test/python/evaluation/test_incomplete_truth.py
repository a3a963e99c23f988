"""A truth that is not all there: with gaps, an early end, or positions alone."""

import json

import numpy as np
import pytest
from conftest import drive, is_png, script, se3_exp

from vi_ekf_slam.bag.reader import read_reference
from vi_ekf_slam.common.geometry import make_transform
from vi_ekf_slam.dataset.pose_files import tum_line
from vi_ekf_slam.evaluation import graphs, top_view
from vi_ekf_slam.evaluation.against_truth import evaluate, judge_covariances, lacks_orientations, truth_line, truth_sections
from vi_ekf_slam.evaluation.run_io import COVARIANCE_COLUMNS

LONG_STAMPS = 100.0 + 0.1 * np.arange(400)
LONG_DRIVE = np.array([se3_exp([0.5 * k, 0, 0, 0, 0, 0.01 * k]) for k in range(400)])


def numbers(folder):
    return json.loads((folder / "evaluation.json").read_text())


def write_poses(path, stamps, poses):
    path.write_text("".join(tum_line(stamp, pose) + "\n" for stamp, pose in zip(stamps, poses)))
    return path


@pytest.mark.parametrize("every", [1, 4, 20])
def test_a_gap_of_the_truth_is_not_bridged(tmp_path, every):
    """The trajectory jumps by 5 m in it: what lies on either side of it alone is right."""
    trajectory, out = LONG_DRIVE.copy(), tmp_path / "out"
    trajectory[200:, :3, 3] += [3.0, 4.0, 0.0]
    kept = np.setdiff1d(np.arange(0, 400, every), np.arange(150, 250))
    arguments = [write_poses(tmp_path / "a.tum", LONG_STAMPS, trajectory), "--truth",
                 write_poses(tmp_path / "truth.tum", LONG_STAMPS[kept], LONG_DRIVE[kept]), "--output", out, "--no-plots"]
    done = script("evaluate.py", *arguments)
    slam = numbers(out)["slam"]
    assert slam["ate_m"] > 1.0 and slam["end_error_percent"] is None, done.stderr
    assert slam["t_rel_percent"] is None or slam["t_rel_percent"] == pytest.approx(0.0, abs=1e-6)
    assert slam["rpe"]["1 frame"]["pairs"] == len(kept) - 2
    for name in ("1 frame", "1 s", "10 m"):
        assert slam["rpe"][name]["translation_m"] == pytest.approx(0.0, abs=1e-6)
    steps = np.diff(kept)
    assert slam["true_path_m"] == pytest.approx(0.5 * steps[steps == every].sum(), rel=1e-2)
    assert "a: the truth has gaps" in done.stdout
    if every > 1:
        seconds = 0.1 * steps[steps == every].sum()
        assert "a: the truth covers %.1f of the 39.9 s of the trajectory" % seconds in done.stdout


def test_a_sparse_truth_that_ends_early_is_remarked(tmp_path):
    kept = np.arange(0, 101, 10)
    done = script("evaluate.py", write_poses(tmp_path / "a.tum", LONG_STAMPS, LONG_DRIVE), "--truth",
                  write_poses(tmp_path / "truth.tum", LONG_STAMPS[kept], LONG_DRIVE[kept]))
    assert "a: the truth covers 10.0 of the 39.9 s of the trajectory" in done.stdout and "has gaps" not in done.stdout


def test_no_line_is_drawn_across_a_gap_of_the_truth():
    kept = np.r_[0:20, 60:400]
    truth = LONG_STAMPS[kept], LONG_DRIVE[kept]
    assert np.array_equal(truth_sections(truth[0], LONG_STAMPS[[0, 19, 60, 399]] + 1e-6), [0, 0, 1, 1])
    assert np.array_equal(truth_sections(100.0 + 10.0 * np.arange(9), np.array([100.0, 180.0])), [0, 0])  # its own step
    line = truth_line(*truth)
    assert np.array_equal(np.flatnonzero(np.isnan(line[:, 0])), [20]) and len(line) == 361
    assert np.isfinite(top_view.view_limits([line])).all()
    covariances = np.array([np.diag([0.01] * 3 + [1e-4] * 3)] * 400)
    figures = (graphs.draw_errors("drive", judge_covariances(LONG_STAMPS, LONG_DRIVE, covariances, truth)),
               graphs.draw_drift("drive", graphs.drift_lines(None, [("SLAM", evaluate(LONG_STAMPS, LONG_DRIVE, truth))])))
    for figure in figures:
        drawn = [axes.get_lines()[0] for axes in figure.axes if axes.get_xlabel() != "length of sub-sequence (m)"]
        assert drawn and all(np.isnan(line.get_ydata()[20]) for line in drawn)


@pytest.mark.parametrize("options, body", [([], "IMU"), (["--truth-body", "left_camera"], "left camera")])
def test_a_truth_of_positions_alone_has_an_ate_alone(run, bag, tmp_path, options, body):
    imu_T_cam = np.linalg.inv(read_reference(bag).cam_T_imu)
    poses = np.array([se3_exp([2.0 * k, 0, 0, 0, 0, 0.2 * k]) for k in range(8)])
    stamps = drive()["time_stamps"][0]
    write_poses(run / "trajectory.tum", stamps, poses)
    row = ",".join("%g" % v for v in np.eye(6)[np.triu_indices(6)])
    (run / "covariance.csv").write_text(
        "stamp," + ",".join(COVARIANCE_COLUMNS) + "\n" + "".join("%.9f,%s\n" % (t, row) for t in stamps))
    held = poses if body == "IMU" else poses @ imu_T_cam
    positions = np.array([make_transform(np.eye(3), p) for p in held[:, :3, 3]])
    assert lacks_orientations(poses, positions) and not lacks_orientations(poses, poses)
    assert not lacks_orientations(positions, positions)  # neither turns, as a simulated body may not
    truth = write_poses(tmp_path / "truth.tum", stamps, positions)
    done = script("evaluate.py", run, "--bag", bag, "--truth", truth, *options)
    assert "run: the truth has one orientation throughout" in done.stdout, done.stderr
    assert "its positions alone are compared, as the %s's\n" % body in done.stdout
    data = numbers(run)
    assert data["slam"]["body"] == body and data["slam"]["ate_m"] == pytest.approx(0.0, abs=1e-6)
    assert data["consistency"] is None and data["slam"]["orientation_deg"] is None and data["slam"]["end_error_m"] is None
    assert data["slam"]["t_rel_percent"] is None and data["slam"]["rpe"]["1 frame"]["translation_m"] is None
    assert is_png(run / "evaluation_errors.png") and not (run / "evaluation_drift.png").exists()
    done = script("plot.py", "run", run, "--bag", bag, "--truth", truth, *options)
    assert "slam: ATE 0.000 m (%s, 8 poses), the truth has positions alone" % body in done.stdout, done.stderr
