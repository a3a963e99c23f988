"""Stamps of drives that are folders: those that do not increase, and those of pictures that belong together."""

import numpy as np
import pytest
import rosbag
from folders import ASL_STAMPS, MAKERS, asl_folder, convert, options

from vi_ekf_slam.bag.converter import main
from vi_ekf_slam.bag.reader import read_reference
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.recordings.asl import load_asl
from vi_ekf_slam.recordings.image_files import Faults
from vi_ekf_slam.recordings.recording import increasing_rows


@pytest.mark.parametrize("kind, name, stream", [
    ("asl", "mav0/imu0/data.csv", "/imu"), ("asl", "mav0/state_groundtruth_estimate0/data.csv", "/ground_truth/pose"),
    ("kitti raw", "oxts/timestamps.txt", "/imu"), ("kitti raw", "image_00/timestamps.txt", "/left/image/compressed"),
    ("kitti odometry", "times.txt", "/left/image/compressed")])
def test_rows_whose_stamps_do_not_increase_are_named_and_left_out_when_asked(tmp_path, capfd, kind, name, stream):
    folder = MAKERS[kind](tmp_path / "drive")
    path = folder / name
    if not path.exists():
        path.parent.mkdir()
        path.write_text("#\n" + "".join("%d,%d,0,0,1,0,0,0\n" % (stamp, k) for k, stamp in enumerate(ASL_STAMPS)))
    kept = [stamp for stamp, _ in convert(folder, tmp_path)[stream]]
    lines = path.read_text().splitlines(True)
    last, before = (line.split(",")[0] for line in (lines[-1], lines[-2]))
    path.write_text("".join(lines[:-1] + [lines[-1].replace(last, before, 1)]))
    assert main([str(folder), str(tmp_path / "x.bag")]) == 2 and not (tmp_path / "x.bag").exists()
    complaint = capfd.readouterr().err
    assert "%s is not increasing" % path in complaint and "--skip-bad" in complaint and complaint.count("\n") == 1
    found = [stamp for stamp, _ in convert(folder, tmp_path, "--skip-bad")[stream]]
    assert found == kept[:-1]
    assert main([str(folder), "--info", "--skip-bad"]) == 0
    assert "left out: %s is not increasing" % path in capfd.readouterr().out


@pytest.mark.parametrize("stamps, left_out", [([1, 2, 2, 3], [2]), ([1, 9, 2, 3], [1]), ([5, 6, 1, 7], [2]), ([7, 1, 2], [0]),
                                              ([1, 3, 2, 4], [1]), ([4, 4, 4], [1, 2]), ([1, 2, 3], [])])
def test_as_few_rows_as_can_be_are_left_out(stamps, left_out):
    """One that is far ahead does not take those after it away."""
    assert list(np.flatnonzero(~increasing_rows(stamps, "here", Faults(True)))) == left_out


def shift(camera, k, nanoseconds):
    """A picture of a camera's folder is later by so much."""
    stem, table = str(ASL_STAMPS[k]), camera / "data.csv"
    later = str(ASL_STAMPS[k] + nanoseconds)
    (camera / "data" / (stem + ".png")).rename(camera / "data" / (later + ".png"))
    table.write_text(table.read_text().replace(stem, later))


def test_pictures_some_microseconds_apart_are_pairs_at_the_left_ones_stamp(tmp_path):
    folder = asl_folder(tmp_path / "drive")
    right = folder / "mav0" / "cam1"
    for k, apart in enumerate((2000, -2000, 4900000, 0)):
        shift(right, k, apart)
    recording = load_asl(str(folder), options())
    assert list(recording.images.stamps) == list(ASL_STAMPS) and str(ASL_STAMPS[1] - 2000) in recording.images.right[1]
    assert any("differ by up to 4.900 ms" in note for note in recording.notes)
    (right / "data" / ("%d.png" % ASL_STAMPS[3])).unlink()  # and one that is alone does not take its neighbour's
    found = load_asl(str(folder), options(skip_bad=True))
    assert list(found.images.stamps) == list(ASL_STAMPS[:3])


def test_pictures_more_than_the_nodes_tolerance_apart_are_no_pair(tmp_path):
    folder = asl_folder(tmp_path / "drive")
    shift(folder / "mav0" / "cam1", 2, 5000001)
    with pytest.raises(InputError, match="cam1: has no picture beside .*%d.png; .*cam0: has no picture beside" % ASL_STAMPS[2]):
        load_asl(str(folder), options())
    assert len(load_asl(str(folder), options(skip_bad=True)).images.stamps) == 3


def test_a_rigs_own_topics_are_found_for_an_evaluation(tmp_path):
    """Frames are the pictures, which camera_info, published once, does not count; names that nobody can tell are not guessed."""
    convert(asl_folder(tmp_path / "drive"), tmp_path)
    names = {"/imu": "/imu0", "/left/image/compressed": "/cam0/image_raw/compressed", "/left/camera_info": "/cam0/camera_info",
             "/right/image/compressed": "/cam1/image_raw/compressed", "/right/camera_info": "/cam1/camera_info"}
    expected = read_reference(str(tmp_path / "out.bag"))
    with rosbag.Bag(str(tmp_path / "out.bag")) as source, rosbag.Bag(str(tmp_path / "own.bag"), "w") as target:
        written = set()
        for topic, message, time in source.read_messages():
            if not topic.endswith("camera_info") or topic not in written:
                target.write(names.get(topic, topic), message, time)
                written.add(topic)
    found = read_reference(str(tmp_path / "own.bag"))
    assert found.frame_stamps == pytest.approx(1e-9 * ASL_STAMPS) and found.camera == expected.camera
    assert np.array_equal(found.cam_T_imu, expected.cam_T_imu)
