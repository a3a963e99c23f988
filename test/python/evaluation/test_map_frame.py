"""NEES of what began uncertain of where it is, since it was found in a map: errors are drawn by covariances that are right."""

import json

import numpy as np
import pytest
from conftest import script, se3_exp

from vi_ekf_slam.common.geometry import make_transform, so3_exp
from vi_ekf_slam.dataset.pose_files import tum_line
from vi_ekf_slam.evaluation.against_truth import judge_covariances
from vi_ekf_slam.evaluation.gauge import covariances_of_frame, frame_change
from vi_ekf_slam.evaluation.run_io import COVARIANCE_COLUMNS

SIGMAS = np.repeat([0.2, 0.005], 3)  # m, rad, of a vehicle that has just been found
TRUTH = np.array([se3_exp([2.0 * k, 0.02 * k * k, 0.3 * np.sin(k), 0.02 * np.sin(k), 0.02 * np.cos(k), 0.05 * k]) for k in range(60)])
STAMPS = 1.0 + 0.1 * np.arange(60)
OTHER_WORLD = make_transform(so3_exp([0, 0, 2.5]), [30.0, -7.0, 2.0])


def moved_by(errors, poses):
    """Poses with errors (p^ - p, Log(R^ R^T))."""
    return np.array([make_transform(so3_exp(e[3:]) @ pose[:3, :3], pose[:3, 3] + e[:3]) for e, pose in zip(errors, poses)])


def mean_nees(gauge, scales, draw, map_starts=()):
    """Mean over 100 drives in a map. scales (60,) of SIGMAS; draw(random): (60, 6) in sigmas."""
    random = np.random.default_rng(7)
    covariances = np.array([np.diag((scale * SIGMAS) ** 2) for scale in scales])
    world = np.eye(4) if gauge == "none" else OTHER_WORLD
    values = []
    for _ in range(100):
        estimate = moved_by(draw(random) * scales[:, None] * SIGMAS, TRUTH)
        values.append(judge_covariances(STAMPS, estimate, covariances, (STAMPS, world @ TRUTH), gauge, map_starts).nees)
    return np.mean(values, axis=0)


def independent(random):
    """Errors of frames that are each located in the map by what they see."""
    return random.normal(size=(60, 6))


def lasting(random):
    """Positions have one error for all: what the map's landmarks have in common."""
    return np.column_stack([np.tile(random.normal(size=3), (60, 1)), random.normal(size=(60, 3))])


# The first ten frames see little of the map, one sees most of it.
LEARNING = np.where(np.arange(60) < 10, 3.0, 1.0)
LEARNING[40] = 0.5


@pytest.mark.parametrize("gauge", ["pose", "yaw"])
def test_in_an_unknown_map_the_frame_s_own_covariance_counts(gauge):
    values = mean_nees(gauge, LEARNING, independent)
    # With the frame of one pose that is uncertain they have one error in common.
    others = np.delete(values, 40)
    assert values[40] == pytest.approx(0.0 if gauge == "pose" else 2.0, abs=0.3)
    assert np.mean(others) == pytest.approx(6.0, abs=0.3) and others.max() < 8.0
    assert mean_nees(gauge, LEARNING, lasting).max() < 6.0  # less, never more, where errors are alike


@pytest.mark.parametrize("draw", [independent, lasting])
@pytest.mark.parametrize("gauge", ["pose", "yaw", "none"])
def test_in_the_map_of_an_earlier_start_nees_is_of_the_error_in_that_map(gauge, draw):
    # That start saw the truth of the first pose from the origin of its map, at another time; one between them, which does
    # not fit, began elsewhere.
    earlier = STAMPS - 50.0, TRUTH
    wrong = STAMPS - 20.0, se3_exp([5.0, 0, 0, 0, 0, 1.0]) @ TRUTH
    stamps = np.concatenate([earlier[0], wrong[0], STAMPS])
    world = np.eye(4) if gauge == "none" else OTHER_WORLD
    truth = stamps + 100.0, world @ np.concatenate([TRUTH] * 3)
    random, covariance = np.random.default_rng(7), np.diag(SIGMAS**2)
    values = [judge_covariances(STAMPS + 100.0, moved_by(draw(random) * SIGMAS, TRUTH), np.tile(covariance, (60, 1, 1)), truth, gauge,
                                [(s + 100.0, p) for s, p in (wrong, earlier)]).nees for _ in range(100)]
    assert np.mean(values) == pytest.approx(6.0, abs=0.75)  # lasting: position NEES has a sigma of sqrt(6 / 100) = 0.24


def test_what_an_error_of_the_frame_is_elsewhere():
    pose, there = TRUTH[3], TRUTH[50]
    error = np.array([0.01, -0.02, 0.03, 1e-4, 2e-4, -3e-4])
    frame = frame_change(moved_by([error], [pose])[0], pose, "pose")
    moved = frame @ there
    (covariance,) = covariances_of_frame(np.outer(error, error), pose, there[None], "pose")
    assert np.sqrt(np.diag(covariance)[:3]) == pytest.approx(np.abs(moved[:3, 3] - there[:3, 3]), rel=1e-3)
    assert not covariances_of_frame(np.eye(6), pose, there[None], "none").any()
    (levelled,) = covariances_of_frame(np.eye(6), pose, there[None], "yaw")
    assert levelled[5, 5] == 1.0 and not levelled[3:5].any() and not levelled[:, 3:5].any()


def test_a_start_of_its_own_is_judged_as_ever():
    # It drifts from nothing: e_k is A e_m and more, and the first pose is the most certain one.
    covariances = np.array([np.diag(((0.001 + 0.01 * k) * SIGMAS) ** 2) for k in range(60)])
    estimate = moved_by(np.array([0.01 * k * SIGMAS for k in range(60)]), TRUTH)
    judged = judge_covariances(STAMPS, estimate, covariances, (STAMPS, OTHER_WORLD @ TRUTH))
    assert judged.nees == pytest.approx([6.0 * (0.01 * k / (0.001 + 0.01 * k)) ** 2 for k in range(60)], abs=1e-6)
    assert judged.deviations[:, 0] == pytest.approx((0.001 + 0.01 * np.arange(60)) * 0.2)


def write_start(folder, stamps, poses, sigmas):
    folder.mkdir(parents=True)
    (folder / "trajectory.tum").write_text("".join(tum_line("%.9f" % t, pose) + "\n" for t, pose in zip(stamps, poses)))
    row = ",".join("%.17g" % v for v in np.diag(sigmas**2)[np.triu_indices(6)])
    (folder / "covariance.csv").write_text("stamp," + ",".join(COVARIANCE_COLUMNS) + "\n"
                                           + "".join("%.9f,%s\n" % (t, row) for t in stamps))


@pytest.mark.parametrize("folders, first, expected", [
    (("map", "search"), "before_reset_1", 12.0), (("search",), "before_reset_1", 0.0), (("map", "search"), "other", 0.0)],
    ids=["map of before", "a loaded map", "not there any more"])
def test_evaluate_finds_the_start_whose_map_it_is(tmp_path, folders, first, expected):
    """A run of 20 poses that are off by two standard deviations of x, y and z in the map of `map`; `search` ends as it begins."""
    run = tmp_path / "run"
    error = np.concatenate([2.0 * SIGMAS[:3], np.zeros(3)])
    write_start(run, STAMPS[40:], moved_by([error] * 20, TRUTH[40:]), SIGMAS)
    for name, rows in (("map", slice(0, 20)), ("search", slice(35, 40))):
        if name in folders:
            number = folders.index(name) + 1
            start = TRUTH[rows] if name == "map" else np.linalg.inv(TRUTH[35]) @ TRUTH[rows]
            write_start(run / (first if number == 1 else "before_reset_%d" % number), STAMPS[rows], start, np.full(6, 1e-6))
    for name in ("dead_reckoning.tum", "landmarks.csv"):
        (run / name).write_text((run / "trajectory.tum").read_text() if name.endswith(".tum") else "id,x,y,z,xx,xy,xz,yy,yz,zz\n")
    (run / "summary.yaml").write_text("relocalisations: 1\nposes_before_resets: %s\n" % [20, 5][:len(folders)])
    truth = tmp_path / "truth.tum"
    truth.write_text("".join(tum_line("%.9f" % t, pose) + "\n" for t, pose in zip(STAMPS, TRUTH)))
    done = script("evaluate.py", run, "--truth", truth, "--no-plots")
    assert done.returncode == 0 and done.stderr == "", done.stderr
    found = json.loads((run / "evaluation.json").read_text())["consistency"]["pose_nees"]
    assert found == pytest.approx(expected, abs=1e-3)
