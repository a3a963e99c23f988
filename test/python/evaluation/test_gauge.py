"""Which frame the truth is compared in, by what of it the estimate was free to choose."""

import json

import numpy as np
import pytest
from conftest import script, se3_exp

from vi_ekf_slam.common.geometry import make_transform, so3_exp
from vi_ekf_slam.dataset.pose_files import tum_line
from vi_ekf_slam.evaluation.against_truth import evaluate, judge_covariances
from vi_ekf_slam.evaluation.gauge import errors_after_yaw_alignment, frame_change, gauge_of, yaw_of
from vi_ekf_slam.evaluation.metrics import rigid_alignment

STAMPS = np.arange(1.0, 41.0)
POSES = np.array([se3_exp([0.5 * k, 0.02 * k * k, 0.3 * np.sin(k), 0.1 * np.sin(k), 0.2 * np.cos(k), 0.1 * k])
                  for k in range(40)])
TURNED = make_transform(so3_exp([0, 0, 2.5]), [30.0, -7.0, 2.0])  # another heading and another origin
TILTED = make_transform(so3_exp([0.02, 0, 0]), [0, 0, 0])


def test_yaw_alignment_takes_away_heading_and_position_and_nothing_else():
    assert np.allclose(rigid_alignment(POSES[:, :3, 3], (TURNED @ POSES)[:, :3, 3], yaw_of), TURNED)
    assert errors_after_yaw_alignment(POSES, TURNED @ POSES) == pytest.approx((0.0, 0.0), abs=1e-5)
    position, orientation = errors_after_yaw_alignment(POSES, TILTED @ POSES)
    assert position > 0.05 and orientation == pytest.approx(np.degrees(0.02), rel=0.02)


def test_no_other_heading_or_position_gives_a_smaller_error():
    random = np.random.default_rng(4)
    target = (TURNED @ POSES)[:, :3, 3] + 0.3 * random.normal(size=(40, 3))
    best = rigid_alignment(POSES[:, :3, 3], target, yaw_of)

    def cost(transform):
        return np.sum((POSES[:, :3, 3] @ transform[:3, :3].T + transform[:3, 3] - target) ** 2)
    for step in np.vstack([np.eye(4), -np.eye(4)]) * 1e-3:
        assert cost(make_transform(so3_exp([0, 0, step[3]]) @ best[:3, :3], best[:3, 3] + step[:3])) > cost(best)


def test_the_orientation_rmse_by_hand():
    turned = POSES.copy()
    turned[::2, :3, :3] = turned[::2, :3, :3] @ so3_exp([0, 0.03, 0])
    assert errors_after_yaw_alignment(turned, POSES)[1] == pytest.approx(np.degrees(0.03) / np.sqrt(2.0))


@pytest.mark.parametrize("gauge, world", [("pose", TURNED @ TILTED), ("yaw", TURNED), ("none", np.eye(4))])
def test_the_truth_is_moved_by_what_is_free(gauge, world):
    covariances = np.tile(np.diag([0.01] * 3 + [1e-4] * 3), (40, 1, 1))
    judged = judge_covariances(STAMPS, POSES, covariances, (STAMPS, world @ POSES), gauge)
    assert np.allclose(judged.nees, 0.0, atol=1e-9)


def test_what_is_not_free_counts_as_an_error():
    covariances = np.tile(np.diag([0.01] * 3 + [1e-4] * 3), (40, 1, 1))
    # The estimate is tilted by 0.02 rad, two standard deviations, and shifted by 0.1 m, one.
    tilted = POSES.copy()
    tilted[:, :3, :3] = TILTED[:3, :3] @ POSES[:, :3, :3]
    tilted[:, 0, 3] += 0.1
    for gauge, expected in (("none", 4.0 + 1.0), ("yaw", 4.0)):
        judged = judge_covariances(STAMPS, tilted, covariances, (STAMPS, POSES), gauge)
        assert judged.nees[0] == pytest.approx(expected, rel=1e-2)


def test_frame_change_by_yaw_leaves_the_tilt():
    change = frame_change(TURNED @ TILTED @ POSES[7], POSES[7], "yaw")
    assert np.allclose(change[:3, :3] @ [0, 0, 1], [0, 0, 1]) and np.allclose(yaw_of(TURNED[:3, :3]), TURNED[:3, :3])
    assert np.allclose((change @ POSES[7])[:3, 3], (TURNED @ TILTED @ POSES[7])[:3, 3])


def test_errors_after_yaw_alignment_are_there_where_gravity_is_known():
    assert evaluate(STAMPS, POSES, (STAMPS, TURNED @ POSES)).ate_yaw is None
    judged = evaluate(STAMPS, POSES, (STAMPS, TURNED @ POSES), gauge="yaw")
    assert judged.ate_yaw == pytest.approx(0.0, abs=1e-9) and judged.orientation == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("summary, gauge", [({}, "pose"), ({"motion": "inertial"}, "yaw"),
                                            ({"motion": "inertial", "start": "given"}, "none")])
def test_a_run_says_what_it_was_free_to_choose(summary, gauge):
    assert gauge_of(summary) == gauge


def test_evaluate_takes_the_truth_of_a_file_in_its_own_world(tmp_path):
    def write(name, poses):
        path = tmp_path / name
        path.write_text("".join(tum_line("%.9f" % t, pose) + "\n" for t, pose in zip(STAMPS, poses)))
        return path
    truth = write("truth.tum", POSES)
    for trajectory, expected in (("turned", TURNED @ POSES), ("tilted", TILTED @ POSES)):
        out = tmp_path / trajectory
        done = script("evaluate.py", write(trajectory + ".tum", expected), "--truth", truth, "--gauge", "yaw", "--no-plots",
                      "--output", out)
        assert done.returncode == 0 and "ATE, yaw-aligned, IMU" in done.stdout, done.stderr
        error = json.loads((out / "evaluation.json").read_text())["slam"]
        if trajectory == "turned":
            assert error["ate_yaw_aligned_m"] == pytest.approx(0.0, abs=1e-6)
        else:
            assert error["orientation_deg"] == pytest.approx(np.degrees(0.02), rel=0.02)
    kitti = tmp_path / "kitti.txt"
    kitti.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    done = script("evaluate.py", tmp_path / "turned.tum", "--truth", kitti, "--gauge", "yaw", "--no-plots")
    assert done.returncode == 2 and str(kitti) in done.stderr


@pytest.mark.parametrize("turn, said", [(TURNED, False), (TILTED, False), (make_transform(so3_exp([0.3, 0.0, 0.0]), np.zeros(3)), True)])
def test_a_truth_whose_z_is_not_upwards_is_told_of(tmp_path, turn, said):
    for name, poses in (("run", POSES), ("truth", turn @ POSES)):
        (tmp_path / (name + ".tum")).write_text("".join(tum_line(*row) + "\n" for row in zip(STAMPS, poses)))
    for gauge, tells in (("yaw", said), ("pose", False)):
        done = script("evaluate.py", tmp_path / "run.tum", "--truth", tmp_path / "truth.tum", "--gauge", gauge, "--no-plots")
        assert done.returncode == 0 and ("run: upwards is 17 deg off the truth's" in done.stdout) == tells, done.stdout
