"""plot.py maps: which landmarks it takes, when they were seen, and what it refuses."""

import numpy as np
import pytest
from conftest import drive, is_png

from vi_ekf_slam.evaluation.map_comparison import Map, common_place, main, read_tracks, zoom_limits


def test_tracks_are_those_of_the_bag(bag):
    seen = (drive()["features"] >= 0.0).all(axis=0)  # ids x frames
    tracks, stamps = read_tracks(bag, "/features")
    assert len(stamps) == seen.shape[1]
    assert sorted(tracks) == list(range(len(seen)))
    for id_, frames in enumerate(seen):
        assert tracks[id_][0] == frames.sum()
        assert tracks[id_][1] == pytest.approx(np.flatnonzero(frames)[-1] / (seen.shape[1] - 1), abs=1e-6)


def test_landmarks_that_were_seen_long_enough_are_drawn(run):
    positions, late = Map(str(run)).select({7: (12, 0.9), 8: (9, 0.9), 9: (10, 0.2)}, 10)
    assert np.array_equal(positions[:, 0], [20, 5000]) and late.tolist() == [True, False]


def test_ids_have_all_their_bits(run):
    path, first = run / "landmarks.csv", 2**63 + 5  # as a loaded map's
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header] + ["%d,%s" % (first + k, row.split(",", 1)[1]) for k, row in enumerate(rows)]) + "\n")
    positions, _ = Map(str(run)).select({first + 1: (12, 0.9)}, 10)
    assert len(positions) == 1


def test_the_enlarged_part_is_where_all_maps_have_landmarks():
    trajectory = np.column_stack([np.arange(0.0, 301.0, 100.0), np.zeros(4), np.zeros(4)])
    here, there, back = (np.array([[x, k, 0.0] for k in range(5)]) for x in (0.0, 100.0, 200.0))
    late = np.ones(10, dtype=bool)
    one, other = (np.vstack([here, there]), late), (np.vstack([there, back]), late)
    assert common_place(trajectory, [one, other], 20.0).tolist() == [100.0, 0.0]
    both_halves = (np.vstack([here, there, back[:1]]), np.arange(11) == 10)
    twice = (np.vstack([there, there, back[:2]]), np.arange(12) == 10)
    assert common_place(trajectory, [both_halves, twice], 20.0).tolist() == [100.0, 0.0]
    twice_driven = (np.vstack([there, back[:2]]), np.arange(7) == 5)
    assert common_place(trajectory, [twice_driven, twice], 20.0).tolist() == [200.0, 0.0]


@pytest.mark.parametrize("width, side", [(8.0, 2.0), (400.0, 60.0)])
def test_the_enlarged_part_is_smaller_than_the_map(run, width, side):
    (low, high), _ = zoom_limits(None, [Map(str(run))], [(np.zeros((1, 3)), np.array([True]))], ((0.0, width), (0.0, 0.5 * width)))
    assert high - low == pytest.approx(side)


def test_a_picture_is_drawn(run, bag, tmp_path):
    output = tmp_path / "maps.png"
    arguments = [str(run), str(run), "--bag", bag, "--least", "1", "--names", "$^$", "b", "--output", str(output)]
    assert main(arguments) == 0 and is_png(output)
    assert main(arguments + ["--zoom", "0", "0", "20", "--names", "a", "b"]) == 0
    assert main([str(run), "--least", "1", "--bag", bag, str(run), "--output", str(output)]) == 0


def test_a_run_of_another_time_is_refused(run, bag, tmp_path, capsys):
    for name in ("trajectory.tum", "dead_reckoning.tum"):
        (run / name).write_text((run / name).read_text().replace("1317386", "1317387"))
    assert main([str(run), "--bag", bag, "--least", "1", "--output", str(tmp_path / "maps.png")]) == 2
    assert "%s: is of another time than the features of %s" % (run, bag) in capsys.readouterr().err


@pytest.mark.parametrize("options, message", [
    (["--output", "maps.pdf"], "ends in .png"), (["--names", "a", "b"], "2 names for 1 runs"),
    (["--zoom", "0", "0", "-1"], "allowed: more than 0"), (["--zoom", "nan", "0", "5"], "--zoom is nan 0 5, allowed: finite"),
    (["--features", "/none"], "has no features on /none; of pictures, run_bag --save-features"),
    (["--features", "imu"], "has no features on /imu; of pictures"),
    (["--least", "100"], "run: of its 3 landmarks none was seen in 100 frames of "),
    (["--bag", "none.bag"], "no such file")])
def test_bad_requests_are_refused(run, bag, tmp_path, capsys, options, message):
    assert main([str(run), "--bag", bag, "--output", str(tmp_path / "maps.png")] + options) == 2
    assert message in capsys.readouterr().err and not (tmp_path / "maps.png").exists()
