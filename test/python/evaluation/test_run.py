"""Reading, judging and drawing a run directory."""

import os
import signal

import numpy as np
import pytest
from conftest import LANDMARK_HEADER as HEADER
from conftest import TRUE_POSITIONS, drive, is_png, script, se3_exp, tum

from vi_ekf_slam.bag.reader import read_reference
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse, make_transform
from vi_ekf_slam.dataset.pose_files import read_tum
from vi_ekf_slam.evaluation import pictures, run_evaluator, top_view
from vi_ekf_slam.evaluation.against_truth import anchor_truth, evaluate
from vi_ekf_slam.evaluation.plots import KINDS
from vi_ekf_slam.evaluation.run_io import read_run

STAMPS = drive()["time_stamps"][0]


def test_a_run_is_read(run):
    data = read_run(str(run))
    assert np.allclose(data.poses[:, :3, 3], TRUE_POSITIONS) and np.allclose(data.stamps, STAMPS, atol=1e-6)
    assert data.dead_poses[7][1, 3] == 24.5 and data.summary == {"estimator": "invariant", "frames": 8}
    assert np.array_equal(data.landmarks[0], [20, 5, 1])
    assert np.array_equal(data.landmark_covariances[1], [[2, 1, 0.5], [1, 2, 0.25], [0.5, 0.25, 3]])


def test_horizontal_deviation_is_along_the_worst_direction(run):
    # [[2, 1], [1, 2]] has the eigenvalues 3 and 1.
    assert np.allclose(read_run(str(run)).horizontal_deviations(), [0.2, np.sqrt(3.0), 10.0])


def test_a_run_without_landmarks_is_read(run):
    (run / "landmarks.csv").write_text(HEADER + "\n")
    assert read_run(str(run)).landmarks.shape == (0, 3) and read_run(str(run)).horizontal_deviations().shape == (0,)


@pytest.mark.parametrize("name, content, message", [
    ("trajectory.tum", None, "cannot be read"), ("trajectory.tum", "1 2 3\n", "line 1 has 3 columns"),
    ("trajectory.tum", "1 nan 0 0 0 0 0 1\n", "line 1 holds 'nan'"), ("dead_reckoning.tum", "", "holds no pose"),
    ("landmarks.csv", "", "line 1"), ("landmarks.csv", "a,b\n", "line 1 is 'a,b'"),
    ("landmarks.csv", HEADER + "\n1,2,3\n", "line 2"), ("landmarks.csv", HEADER + "\n1,x,0,0,1,0,0,1,0,1\n", "line 2"),
    ("landmarks.csv", HEADER + "\n1,0,0,0,1,0,0,inf,0,1\n", "line 2"), ("landmarks.csv", None, "cannot be read"),
    ("summary.yaml", "a: [\n", "cannot be read"), ("summary.yaml", "body: 5\n", "body is 5, allowed: a name"),
    ("summary.yaml", "- 1\n", "no mapping"),
])
def test_malformed_runs_are_refused(run, name, content, message):
    if content is None:
        os.remove(str(run / name))
    else:
        (run / name).write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        read_run(str(run))
    assert str(caught.value).startswith(str(run / name)) and "\n" not in str(caught.value)


def test_dead_reckoning_can_come_from_another_run(run, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "dead_reckoning.tum").write_text(tum([(9.0, 9.0, 9.0)] * 8))
    assert np.allclose(read_run(str(run), str(other)).dead_poses[:, :3, 3], 9.0)
    with pytest.raises(InputError, match="is not a directory"):
        read_run(str(tmp_path / "none"))


def test_evaluation_matches_by_stamp():
    # The estimate lacks frames 0 and 3 and lives in another world frame; the truth lacks the last.
    poses = np.array([se3_exp([5.0 * k, 0.3 * k * k, 0, 0, 0, 0.1 * k]) for k in range(8)])
    world = se3_exp([3, -2, 1, 0.3, 0.2, 2.0])
    kept = [1, 2, 4, 5, 6, 7]
    cam_T_imu = make_transform(np.eye(3), [0, 0, 2.0])
    for extrinsic, body in ((None, "IMU"), (cam_T_imu, "left camera")):
        result = evaluate(STAMPS[kept], world @ poses[kept], (STAMPS[:7], poses[:7]), extrinsic)
        assert result.matched == 5 and result.body == body
        assert result.ate == pytest.approx(0.0, abs=1e-9)
    shifted = evaluate(STAMPS[:7], poses[1:], (STAMPS, poses))
    assert shifted.ate > 0.1  # a frame off is an error
    with pytest.raises(InputError, match="does not meet"):
        evaluate(STAMPS + 100.0, poses, (STAMPS, poses))


def test_evaluation_at_the_camera_sees_the_lever_arm():
    # The IMU stands still and turns; an estimate that does not turn is right at the IMU and wrong 2 m ahead of it.
    truth = np.array([se3_exp([0, 0, 0, 0, 0, 0.3 * k]) for k in range(8)])
    still = np.array([np.eye(4)] * 8)
    assert evaluate(STAMPS, still, (STAMPS, truth)).ate == pytest.approx(0.0, abs=1e-9)
    assert evaluate(STAMPS, still, (STAMPS, truth), make_transform(np.eye(3), [-2.0, 0, 0])).ate > 1.0


def test_truth_is_anchored_rigidly_at_the_first_common_pose():
    truth = np.array([se3_exp([5.0 * k, 0, 0, 0, 0, 0.1 * k]) for k in range(8)])
    estimate = se3_exp([1, 2, 3, 0, 0, 1.0]) @ truth[2:] @ se3_exp([0, 0, 0, 0, 0, 0.2])
    anchored = anchor_truth((STAMPS, truth), STAMPS[2:], estimate)
    assert np.allclose(anchored[2], estimate[0])
    assert np.allclose(inverse(anchored[0]) @ anchored[7], inverse(truth[0]) @ truth[7])


def outside(points, limits):
    return int(np.sum(~top_view.inside(points, limits)))


def test_view_holds_every_trajectory_and_ignores_far_landmarks():
    line = np.array([[0.0, 0, 0], [100.0, 0, 0]])
    (x_min, x_max), (y_min, y_max) = top_view.view_limits([line, line + [0, 30.0, 0]])
    assert x_min < 0 and x_max > 100 and y_min < 0 and y_max > 30 and x_max - x_min < 150
    assert outside(np.array([[50.0, 0, 0], [5000.0, 0, 0], [np.nan, 0, 0]]),
                                  ((x_min, x_max), (y_min, y_max))) == 2


def test_view_of_a_room_holds_most_of_its_landmarks():
    """Which are around the path: a view of the path alone would show hardly any."""
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    circle = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    walls = 4.0 * circle / np.abs(circle).max(axis=1, keepdims=True)
    far = np.array([[5000.0, 0.0, 0.0]])
    (x_min, x_max), (y_min, y_max) = limits = top_view.view_limits([circle], landmarks=np.vstack([walls, far]))
    assert outside(walls, limits) < 20 and x_max - x_min < 9.0 and y_max - y_min < 9.0
    assert outside(walls, top_view.view_limits([circle])) == 100
    assert top_view.view_limits([circle], landmarks=far) == top_view.view_limits([circle], landmarks=np.zeros((0, 3)))


def texts(figure):
    axes = figure.axes[0]
    return [axes.get_title()] + [t.get_text() for t in axes.texts] + [t.get_text() for t in axes.get_legend().get_texts()]


def test_picture_says_what_it_shows(run):
    data = read_run(str(run))
    slam, dead = data.poses[:, :3, 3], data.dead_poses[:, :3, 3]
    figure = top_view.draw_run("drive", slam, dead, slam, data.landmarks, data.horizontal_deviations())
    assert texts(figure) == ["drive", "3 landmarks, 1 of them outside this view", "truth", "dead reckoning", "SLAM", "start"]
    assert figure.axes[0].get_aspect() in ("equal", 1.0) and figure.axes[0].get_xlabel() == "x, seen from above (m)"
    figure = top_view.draw_run("drive", slam, dead, None, data.landmarks[:0], np.zeros(0))
    assert texts(figure) == ["drive", "dead reckoning", "SLAM", "start"]


def test_plot_run_prints_errors_and_writes_pictures(run, bag):
    result = script("plot.py", "run", run, "--bag", bag, "--svg")
    assert result.returncode == 0 and result.stderr == "", result.stderr
    slam, dead = result.stdout.splitlines()[:2]
    assert slam.startswith("slam: ATE 0.000 m (left camera, 8 poses)") and "too short" in slam
    assert dead.startswith("dead reckoning: ATE ") and float(dead.split()[3]) > 0.1
    assert is_png(run / "run.png") and b"<svg" in open(str(run / "run.svg"), "rb").read(1000)
    assert not [n for n in os.listdir(str(run)) if n.endswith(".part")]


def test_plot_run_takes_the_truth_from_a_file(run, bag, tmp_path):
    truth, output = tmp_path / "truth.tum", tmp_path / "picture.png"
    result = script("plot.py", "run", run, "--truth", truth, "--output", output)
    assert "slam: ATE 0.000 m (IMU, 8 poses)" in result.stdout and is_png(output), result.stderr
    kitti = tmp_path / "kitti.txt"
    kitti.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 8)
    result = script("plot.py", "run", run, "--truth", kitti, "--bag", bag, "--output", output)
    assert "(left camera, 8 poses)" in result.stdout and float(result.stdout.split()[2]) > 1.0, result.stderr


def test_plot_run_without_truth_draws_all_the_same(run):
    result = script("plot.py", "run", run)
    assert result.returncode == 0 and result.stdout == "wrote: %s\n" % (run / "run.png"), result.stderr


def test_plot_run_refuses_with_one_line(run, tmp_path):
    kitti, junk = tmp_path / "kitti.txt", tmp_path / "junk.bag"
    kitti.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    junk.write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    for arguments, word in ((["--truth", kitti], "--bag is needed"), (["--bag", junk], "cannot be read as a bag"),
                            (["--bag", tmp_path / "none.bag"], "no such file"), (["--output", "a.pdf"], "ends in .png"),
                            (["--output", tmp_path / "none" / "a.png"], "does not exist"),
                            (["--truth-body", "imu"], "needs --truth")):
        result = script("plot.py", "run", run, *arguments)
        assert result.returncode == 2 and result.stdout == "", arguments
        assert result.stderr.startswith("error: ") and word in result.stderr and result.stderr.count("\n") == 1
    assert not (run / "run.png").exists()


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_plot_takes_each_kind_to_its_module(kind):
    result = script("plot.py", kind, "--help")
    assert result.returncode == 0 and result.stdout.startswith("usage: plot.py %s " % kind), result.stderr
    assert script("plot.py", kind, "--nonsense").returncode == 2


def test_the_smoothed_line_lets_slam_be_seen(run, bag):
    moved = [(x, y + 0.01, z) for x, y, z in TRUE_POSITIONS]
    (run / "trajectory_smoothed.tum").write_text(tum(moved))
    subject = run_evaluator.read_subject(str(run), "run", read_reference(bag))
    subject.truth = read_tum(str(run / "trajectory.tum"))
    figures = dict(pictures.pictures_of_run(run_evaluator.judge_subject(subject)))
    for name in ("trajectory", "drift"):
        for axes in figures[name].axes:
            styles = {line.get_label(): line.get_linestyle() for line in axes.get_lines()}
            assert (styles["SLAM"], styles["smoothed"]) == ("-", "--"), (name, styles)


def test_a_signal_ends_it_without_a_traceback(monkeypatch):
    monkeypatch.setattr(run_evaluator, "run_evaluation", lambda _: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(SystemExit) as ended:
        run_evaluator.main(["run"])
    assert ended.value.code == 128 + signal.SIGINT
