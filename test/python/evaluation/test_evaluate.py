"""evaluate.py as a whole: numbers, pictures, formats, refusals."""

import json
import os
from types import SimpleNamespace

import numpy as np
import pytest
import rosbag
from conftest import FRAMES, TRUE_POSITIONS, drive, is_png, process, script, tum

from vi_ekf_slam.bag.reader import read_reference
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import rotation_to_quaternion
from vi_ekf_slam.dataset.pose_files import read_pose_file, read_tum
from vi_ekf_slam.evaluation import graphs, top_view
from vi_ekf_slam.evaluation.against_truth import align, evaluate, judge_covariances, panel_titles
from vi_ekf_slam.evaluation.report import DEFINITIONS, table
from vi_ekf_slam.evaluation.run_evaluator import _remarks
from vi_ekf_slam.evaluation.run_inputs import default_names
from vi_ekf_slam.evaluation.run_io import COVARIANCE_COLUMNS, read_covariances, read_frames

STAMPS = drive()["time_stamps"][0]
PICTURES = ["drift", "errors", "frames", "landmarks", "trajectory"]


def numbers(run):
    with open(str(run / "evaluation.json"), encoding="utf-8") as stream:
        return json.load(stream)


def test_table_json_and_pictures(drawn):
    full_run, _, done, _ = drawn
    assert done.returncode == 0 and done.stderr == "", done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].split() == ["run", "run", "run"] and lines[1].split()[-3:] == ["dead", "reckoning", "SLAM"]
    assert "positions of the left camera" in lines[1]
    cells = {line[:27].strip(): line.split() for line in lines[3:] if line[:27].strip()}
    assert cells["ATE, anchored at the start"][-1] == "0.000" and float(cells["ATE, anchored at the start"][-2]) > 1.0
    assert cells["NIS per dof, 1 is right"][-2:] == ["-", "0.900"]
    assert cells["frame time, longest"][-1] == "7.00"
    for name in PICTURES:
        assert is_png(full_run / ("evaluation_%s.png" % name)), name
        assert b"<svg" in (full_run / ("evaluation_%s.svg" % name)).read_bytes()[:1000]
    data = numbers(full_run)
    assert data["slam"]["body"] == "left camera" and data["slam"]["matched"] == 8
    assert data["slam"]["ate_m"] == pytest.approx(0.0, abs=1e-6) and data["slam"]["t_rel_percent"] is None
    assert data["consistency"]["pose_nees"] == pytest.approx(0.0, abs=1e-6) and data["consistency"]["poses"] == 8
    assert data["frames"]["frames_rejected"] == 1 and data["timing"]["frame_mean_ms"] == pytest.approx(3.5)
    assert data["definitions"] == DEFINITIONS
    assert not [name for name in os.listdir(str(full_run)) if name.endswith(".part")]


def test_figures_of_dead_reckoning_by_hand(full_run, tmp_path):
    # Without a bag the IMUs are compared: dead reckoning is off by 0.3 k^2 m at pose k, and never turns.
    truth = tmp_path / "truth.tum"
    truth.write_text(tum(TRUE_POSITIONS))
    done = script("evaluate.py", full_run, "--truth", truth, "--no-plots")
    assert done.returncode == 0, done.stderr
    assert "positions of the IMU" in done.stdout and "no bag with an extrinsic" in done.stdout
    dead = numbers(full_run)["dead_reckoning"]
    errors = 0.3 * np.arange(8.0) ** 2
    steps = np.diff(errors)
    assert dead["ate_anchored_m"] == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert dead["end_error_m"] == pytest.approx(14.7)
    assert dead["end_error_percent"] == pytest.approx(1470.0 / dead["true_path_m"])
    assert dead["rpe"]["1 frame"]["translation_m"] == pytest.approx(np.sqrt(np.mean(steps**2)))
    assert dead["rpe"]["1 frame"]["rotation_deg"] == pytest.approx(0.0, abs=1e-5) and dead["rpe"]["1 frame"]["pairs"] == 7
    assert dead["rpe"]["1 s"]["translation_m"] is None  # the drive lasts 0.7 s
    assert dead["rpe"]["10 m"]["translation_m"] == pytest.approx(np.sqrt(np.mean((errors[2:] - errors[:-2]) ** 2)))
    assert dead["drift"]["position_error"][-1] == {"distance_m": dead["true_path_m"], "error_m": pytest.approx(14.7)}
    assert not [name for name in os.listdir(str(full_run)) if name.endswith(".png")]


def test_nees_of_a_run_by_hand(full_run, tmp_path):
    # The truth is 0.2 m above the estimate from pose 1 on, two standard deviations: NEES 0, then seven times 4.
    truth = tmp_path / "truth.tum"
    truth.write_text(tum([(x, y, 0.2 if k else 0.0) for k, (x, y, _) in enumerate(TRUE_POSITIONS)]))
    assert script("evaluate.py", full_run, "--truth", truth, "--no-plots").returncode == 0
    found = numbers(full_run)["consistency"]
    assert found["pose_nees"] == pytest.approx(3.5) and found["position_nees"] == pytest.approx(3.5)
    assert found["rotation_nees"] == pytest.approx(0.0, abs=1e-9)
    assert found["within_bounds_percent"] == pytest.approx(87.5)  # 0 is below the lower bound


def test_without_truth_there_are_pictures_and_timing(full_run):
    done = script("evaluate.py", full_run)
    assert done.returncode == 0 and "no truth" in done.stdout and "ATE" not in done.stdout, done.stderr
    assert "frame time, median" in done.stdout
    assert is_png(full_run / "evaluation_errors.png") and not (full_run / "evaluation_drift.png").exists()
    data = numbers(full_run)
    assert data["slam"] is None and data["consistency"] is None and data["timing"]["frame_longest_ms"] == 7.0


def test_an_evaluation_with_truth_is_not_replaced_by_one_without(drawn, tmp_path):
    full_run, both_out, one, two = drawn
    assert one.returncode == 0
    before = {path.name: path.read_bytes() for path in full_run.iterdir()}
    assert "evaluation_drift.png" in before
    for more in ([], ["--no-plots"]):
        done = script("evaluate.py", full_run, *more)
        assert done.returncode == 0 and "kept: %s" % (full_run / "evaluation.json") in done.stdout, done.stderr
        assert {path.name: path.read_bytes() for path in full_run.iterdir()} == before
    out = tmp_path / "elsewhere"
    assert "kept" not in script("evaluate.py", full_run, "--output", out, "--no-plots").stdout
    assert numbers(out)["slam"] is None

    # Of several runs, in their common folder.
    assert two.returncode == 0
    before = {path.name: path.read_bytes() for path in both_out.iterdir() if path.is_file()}
    both = [full_run, full_run / "trajectory.tum", "--name", "first", "--name", "second", "--output", both_out]
    assert script("evaluate.py", *both).returncode == 0
    assert {path.name: path.read_bytes() for path in both_out.iterdir() if path.is_file()} == before


def test_pictures_of_an_earlier_evaluation_do_not_outlive_it(drawn, bag):
    full_run, _, done, _ = drawn

    def pictures():
        return sorted(name[len("evaluation_"):-len(".png")] for name in os.listdir(str(full_run)) if name.endswith(".png"))
    assert done.returncode == 0
    assert pictures() == PICTURES
    (full_run / "frames.csv").unlink()
    assert script("evaluate.py", full_run, "--bag", bag).returncode == 0
    assert pictures() == [name for name in PICTURES if name != "frames"]
    assert script("evaluate.py", full_run, "--bag", bag, "--no-plots").returncode == 0
    assert pictures() == [] and not [name for name in os.listdir(str(full_run)) if name.endswith(".svg")]


def test_poses_before_resets_are_named(full_run):
    (full_run / "summary.yaml").write_text("poses_before_resets: [31, 5]\n")
    done = script("evaluate.py", full_run, "--no-plots")
    assert "31 poses before a reset, in %s" % (full_run / "before_reset_1") in done.stdout, done.stderr
    assert "5 poses before a reset, in %s" % (full_run / "before_reset_2") in done.stdout
    (full_run / "summary.yaml").write_text("poses_before_resets: 5\n")
    done = script("evaluate.py", full_run, "--no-plots")
    assert done.returncode == 2 and "%s: poses_before_resets is 5, allowed: a list" % (full_run / "summary.yaml") in done.stderr


def test_a_run_of_trajectories_alone_will_do(run):
    done = script("evaluate.py", run)
    assert done.returncode == 0 and "evaluation_trajectory.png" in done.stdout, done.stderr
    assert not (run / "evaluation_frames.png").exists() and not (run / "evaluation_errors.png").exists()


def test_exports_are_read_back_and_by_strict_readers(full_run, bag, tmp_path):
    out = tmp_path / "out"
    done = script("evaluate.py", full_run, "--bag", bag, "--no-plots", "--export-tum", "--export-kitti", "--output", out)
    assert done.returncode == 0, done.stderr
    exported = out / "export"
    assert sorted(os.listdir(str(exported))) == sorted(
        name + end for name in ("slam", "dead_reckoning", "truth") for end in (".tum", "_kitti.txt"))
    for path in exported.iterdir():  # evo's readers want exactly one blank between columns and none at the end
        columns = 12 if path.name.endswith("_kitti.txt") else 8
        assert {len(line.split(" ")) for line in path.read_text().splitlines()} == {columns}
        assert len(read_pose_file(str(path))[1]) == 8
    stamps, poses = read_tum(str(exported / "slam.tum"))
    assert np.allclose(stamps, STAMPS, atol=1e-6) and np.allclose(poses[:, :3, 3], TRUE_POSITIONS)
    assert np.allclose(read_tum(str(exported / "truth.tum"))[1], poses, atol=1e-6)
    _, cameras = read_pose_file(str(exported / "slam_kitti.txt"))
    assert np.allclose(cameras[3][:3, 3], [-1.8, 0.0, 15.0], atol=1e-6)  # right, down, forward of (15, 1.8, 0)

    # The exported files in place of DIR have the errors of the run that they come from.
    files = [exported / "dead_reckoning.tum", exported / "dead_reckoning_kitti.txt"]
    done = script("evaluate.py", full_run, *files, "--bag", bag, "--no-plots", "--output", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    runs = numbers(tmp_path / "again")["runs"]
    assert [r["name"] for r in runs] == ["run", "dead_reckoning", "dead_reckoning_kitti"]
    for r in runs[1:]:
        assert r["slam"]["ate_m"] == pytest.approx(runs[0]["dead_reckoning"]["ate_m"], abs=1e-5)
        assert r["dead_reckoning"] is None


def test_kitti_exports_match_row_by_row(full_run, save, tmp_path):
    from vi_ekf_slam.bag.converter import main as convert
    truth, bag = tmp_path / "short.tum", str(tmp_path / "short.bag")
    truth.write_text("".join(tum(TRUE_POSITIONS).splitlines(True)[:6]))  # the truth ends two frames early
    assert convert([save(drive()), bag, "--quiet", "--truth", str(truth)]) == 0
    assert script("evaluate.py", full_run, "--bag", bag, "--no-plots", "--export-kitti").returncode == 0
    for name in ("slam", "dead_reckoning", "truth"):
        assert len(read_pose_file(str(full_run / "export" / (name + "_kitti.txt")))[1]) == 6


def test_several_runs_side_by_side(drawn):
    _, out, _, done = drawn
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0].split() == ["run", "first", "first", "second"]
    assert is_png(out / "evaluation_comparison.png") and is_png(out / "evaluation_comparison_drift.png")
    assert is_png(out / "first" / "evaluation_errors.png") and is_png(out / "second" / "evaluation_trajectory.png")
    assert [r["name"] for r in numbers(out)["runs"]] == ["first", "second"]


def test_one_dead_reckoning_has_one_column():
    errors = {"matched": 8, "body": "IMU"}
    runs = [{"name": n, "slam": errors, "dead_reckoning": errors, "frames": None} for n in ("a", "b")]
    assert table(runs)[0].split() == ["run", "a", "a", "b"]


def test_poses_without_truth_beside_them_are_remarked():
    subject = SimpleNamespace(name="a", summary={}, truth=(), gauge="pose", cam_T_imu=np.eye(4), stamps=np.arange(100.0))
    for matched, words in ((97, []), (60, ["a: 40 of 100 poses have no truth beside them"])):
        remarks = list(_remarks([SimpleNamespace(subject=subject, slam=SimpleNamespace(
            matched=matched, truth_step=None, sections=[0], positions_only=False))]))
        assert len(remarks) == len(words) and all(word in remark for word, remark in zip(words, remarks))


def test_a_truth_sparser_than_the_trajectory_is_remarked(full_run, tmp_path):
    truth = tmp_path / "truth.tum"
    truth.write_text("".join(tum(TRUE_POSITIONS).splitlines(True)[1::3]))
    done = script("evaluate.py", full_run, "--truth", truth, "--no-plots")
    assert "run: the truth is sparser than the trajectory, 0.3 s between its poses" in done.stdout, done.stderr
    assert "have no truth beside them" not in done.stdout
    assert numbers(full_run)["slam"]["matched"] == numbers(full_run)["consistency"]["poses"] == 3


def test_names_tell_runs_apart():
    assert default_names(["x/0027", "y/0034/", "z/orb.tum"]) == ["0027", "0034", "orb"]
    assert default_names(["x/run", "y/run", "z.d"]) == ["x/run", "y/run", "z.d"]


def test_refusals_are_one_line(full_run, bag, tmp_path):
    kitti, far, one = tmp_path / "kitti.txt", tmp_path / "far.tum", tmp_path / "one.tum"
    kitti.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    one.write_text(tum(TRUE_POSITIONS).splitlines(True)[0])
    far.write_text("5 0 0 0 0 0 0 1\n6 0 0 0 0 0 0 1\n")
    for arguments, word in (
            ([tmp_path / "none"], "cannot be read"), ([kitti], "--bag is needed"), ([far, "--bag", bag], "does not meet"),
            ([full_run, "--truth", kitti], "--bag is needed"), ([full_run, "--truth", far], "do not meet"),
            ([full_run, "--bag", bag, "--bag", bag], "--bag is given 2 times"), ([full_run, full_run], "--name"),
            ([full_run, "--export-kitti"], "--export-kitti needs --bag"),
            ([full_run, "--truth-body", "imu"], "--truth-body needs --truth"),
            ([full_run, "--truth", one], " s, shares one pose, of at least two that are needed, with the trajectory"),
            ([full_run, "--config", kitti], "--config is given, allowed with --streams"),
            (["--streams", tmp_path, "--gauge", "yaw"], "--gauge is given, allowed without --streams"),
            ([full_run, "--trajectory-body", "imu"], "--trajectory-body is given, allowed for trajectory files"),
            ([full_run, "--output", full_run / "trajectory.tum"], "cannot be made")):
        done = script("evaluate.py", *arguments)
        assert done.returncode == 2 and done.stdout == "", (arguments, done.stdout)
        assert done.stderr.startswith("error: ") and word in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert not (full_run / "evaluation.json").exists()


def test_without_matplotlib_there_are_numbers(full_run, bag, tmp_path, monkeypatch):
    (tmp_path / "hidden").mkdir()
    (tmp_path / "hidden" / "matplotlib.py").write_text("raise ModuleNotFoundError('none', name='matplotlib')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "hidden"), prepend=os.pathsep)
    done = process("evaluate.py", full_run, "--bag", bag)
    assert done.returncode == 2 and "python3-matplotlib" in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert numbers(full_run)["slam"]["matched"] == 8
    assert process("evaluate.py", full_run, "--bag", bag, "--no-plots").returncode == 0


def test_covariances_are_read_in_their_order(full_run):
    row = [str(v) for v in range(21)]
    (full_run / "covariance.csv").write_text("stamp," + ",".join(COVARIANCE_COLUMNS) + "\n1.0," + ",".join(row) + "\n")
    matrix = read_covariances(str(full_run / "covariance.csv"), np.array([1.0]))[0]
    assert np.array_equal(matrix, matrix.T) and list(matrix[0]) == [0, 1, 2, 3, 4, 5]
    assert matrix[1, 1] == 6 and matrix[3, 5] == 17 and matrix[5, 5] == 20  # `ac` and `cc`
    with pytest.raises(InputError, match="covariance.csv: its 1 stamps are not the 2"):
        read_covariances(str(full_run / "covariance.csv"), np.array([1.0, 2.0]))


def test_frames_without_times_are_drawn_all_the_same(full_run):
    path = full_run / "frames.csv"
    path.write_text("\n".join(line.rsplit(",", 1)[0] for line in path.read_text().splitlines()) + "\n")
    frames = read_frames(str(path))
    assert "update_ms" not in frames and len(graphs.draw_frames("drive", frames).axes) == 2
    path.write_text(FRAMES + "\n")
    assert read_frames(str(path)) is None
    path.write_text("stamp,features\n1,2\n")
    with pytest.raises(InputError, match="frames.csv: line 1 is 'stamp,features', .*allowed: .*nis_dof"):
        read_frames(str(path))


def test_pictures_over_time_say_what_they_show(full_run):
    frames = read_frames(str(full_run / "frames.csv"))
    figure = graphs.draw_frames("drive", frames)
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "features in a frame", "innovation squared over\ncovariance, per dof (NIS)", "time to compute\na frame (ms)"]
    assert "frame rejected (1)" in [t.get_text() for t in figure.axes[0].get_legend().get_texts()]
    assert "all frames: 0.900" in [t.get_text() for t in figure.axes[1].get_legend().get_texts()]
    assert figure.axes[-1].get_xlabel() == "time (s)"

    stamps, poses = read_tum(str(full_run / "trajectory.tum"))
    covariances = read_covariances(str(full_run / "covariance.csv"), stamps)
    figure = graphs.draw_errors("drive", judge_covariances(stamps, poses, covariances, (stamps, poses)))
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["x (m)", "y (m)", "z (m)", "roll (deg)", "pitch (deg)", "yaw (deg)",
                      "error squared over\ncovariance (NEES)"]
    bound = figure.axes[3].collections[0].get_paths()[0].vertices[:, 1].max()
    assert bound == pytest.approx(np.degrees(0.03))  # three times 0.01 rad
    assert len(graphs.draw_errors("drive", judge_covariances(stamps, poses, covariances)).axes) == 6
    stamps = np.linspace(0.0, 3.0 * graphs.START_S, len(stamps))  # long enough for panels of its beginning
    long = judge_covariances(stamps, poses, covariances, (stamps, poses))
    first = [axes for axes in graphs.draw_errors("drive", long).axes if axes.get_xlim()[1] <= graphs.START_S]
    assert len(first) == 7


def test_frames_whose_ids_are_all_new_are_explained(full_run):
    frames = read_frames(str(full_run / "frames.csv"))
    assert len(graphs.draw_frames("drive", dict(frames, used=frames["features"])).texts) == 1  # the title
    new = dict(frames, used=0.0 * frames["used"], frame_rejected=0.0 * frames["used"])
    seen = int(np.sum(frames["features"] > 0.0))
    assert seen > 1 and "In %d frames nothing is used" % (seen - 1) in graphs.draw_frames("drive", new).texts[1].get_text()
    first = np.where(np.cumsum(frames["features"] > 0.0) > 1, 1.0, 0.0)  # of any drive, in which nothing can be used yet
    assert len(graphs.draw_frames("drive", dict(new, used=first)).texts) == 1


def test_a_name_that_begins_with_an_underscore_is_in_the_legend():
    line = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    figure = top_view.draw_trajectories("two", [(top_view.plain(name), line, {}) for name in ("_a", "b")])
    assert [text.get_text().strip() for text in figure.axes[0].get_legend().get_texts()] == ["_a", "b", "start"]


def test_a_repeated_run_is_dashed():
    assert [style["linestyle"] for style in graphs.line_styles(3, [False, True, False])] == ["-", graphs.DASHES, "-"]


def test_the_trajectory_is_drawn_as_its_error_is_stated(full_run):
    stamps, poses = read_tum(str(full_run / "trajectory.tum"))
    turned = np.eye(4)
    turned[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(align((stamps, turned @ poses), (stamps, poses)), poses[:, :3, 3], atol=1e-9)
    evaluation = evaluate(stamps, poses, (stamps, poses))
    lines = [("truth", poses[:, :3, 3], top_view.TRUTH_STYLE)]
    figure = top_view.draw_alignments("drive", [(title, lines) for title in panel_titles(evaluation, evaluation)])
    assert [axes.get_title() for axes in figure.axes] == [
        "from a common start; at the end wrong by\n0 mm (dead reckoning 0 mm)",
        "rigidly aligned; ATE\n0 mm (dead reckoning 0 mm)"]

    evaluation = evaluate(stamps, poses, (stamps, poses))
    figure = graphs.draw_drift("drive", graphs.drift_lines(None, [("SLAM", evaluation)]))
    assert "too short" in figure.axes[1].texts[0].get_text()


def test_poses_of_a_camera_without_an_imu_are_judged_as_such(full_run, bag):
    """summary.yaml names the body: the left camera's poses are compared with the left camera's truth."""
    stamps, poses = read_tum(str(full_run / "trajectory.tum"))
    imu_T_cam = np.linalg.inv(read_reference(bag).cam_T_imu)
    lines = []
    for stamp, pose in zip(stamps, poses @ imu_T_cam):
        q = rotation_to_quaternion(pose[:3, :3])
        lines.append(" ".join("%.9f" % v for v in (stamp, *pose[:3, 3], *q)))
    (full_run / "trajectory.tum").write_text("\n".join(lines) + "\n")
    with open(str(full_run / "summary.yaml"), "a", encoding="utf-8") as stream:
        stream.write('body: "left_camera_optical"\n')
    assert script("evaluate.py", full_run, "--bag", bag, "--no-plots").returncode == 0
    assert numbers(full_run)["slam"]["ate_anchored_m"] == pytest.approx(0.0, abs=1e-6)
    (full_run / "summary.yaml").write_text("frames: 8\n")  # taken for the IMU's
    assert script("evaluate.py", full_run, "--bag", bag, "--no-plots").returncode == 0
    assert numbers(full_run)["slam"]["ate_anchored_m"] > 1.0


def test_a_bag_without_an_imu_is_judged_by_the_frame_above_its_camera(full_run, bag, tmp_path):
    """As a sequence of KITTI's odometry is, whose truth the converter turns into poses of the IMU's place all the same."""
    test_poses_of_a_camera_without_an_imu_are_judged_as_such(full_run, without(bag, tmp_path, "/imu"))


def without(bag, folder, left_out):
    """A copy of a bag that lacks one topic."""
    copy = str(folder / "less.bag")
    with rosbag.Bag(bag) as source, rosbag.Bag(copy, "w") as target:
        for topic, message, time in source.read_messages():
            if topic != left_out:
                target.write(topic, message, time)
    return copy


def test_the_imu_of_a_run_may_have_had_any_topic(full_run, bag, tmp_path):
    """summary.yaml names its frame, for a trajectory file beside the run too; of two IMUs neither is guessed."""
    other = str(tmp_path / "other.bag")
    with rosbag.Bag(bag) as source, rosbag.Bag(other, "w") as target:
        for topic, message, time in source.read_messages():
            for name in ("/imu0", "/imu1") if topic == "/imu" else (topic,):
                target.write(name, message, time)
    done = script("evaluate.py", full_run, "--bag", other, "--no-plots")
    assert "positions of the IMU" in done.stdout and "%s has no left camera and IMU that /tf_static" % other in done.stdout
    with open(str(full_run / "summary.yaml"), "a", encoding="utf-8") as stream:
        stream.write('body: "imu_link"\n')
    done = script("evaluate.py", full_run, full_run / "trajectory.tum", "--bag", other, "--no-plots")
    assert "positions of the left camera" in done.stdout and "positions of the IMU" not in done.stdout, done.stderr


def test_a_name_may_hold_what_means_mathematics_to_the_pictures(full_run, bag, tmp_path):
    done = script("evaluate.py", full_run, full_run / "trajectory.tum", "--bag", bag, "--name", "$^$ a",
                  "--name", "$_$ b", "--output", tmp_path / "out")
    assert done.returncode == 0 and is_png(tmp_path / "out" / "evaluation_comparison.png"), done.stderr
