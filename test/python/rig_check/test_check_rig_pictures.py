"""Broken rigs of pictures and an IMU, drawn by simulate_dataset.py --images."""

import argparse

import breaking
import cv2
import numpy as np
import pytest
import rigs

from vi_ekf_slam.recordings import asl
from vi_ekf_slam.rig_check.checker import make_report
from vi_ekf_slam.rig_check.finding import GREEN, RED, YELLOW
from vi_ekf_slam.simulation.simulator import main as simulate

OPTIONS = dict(remap=[], duration=0.0, imu_noise=None, without_load=True)
LEFT, RIGHT, SIDES = "/left/image", "/right/image", ("/left/image", "/right/image")


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Entries of 5.5 s in a room."""
    folder = str(tmp_path_factory.mktemp("room") / "room")
    assert simulate([folder, "--images", "--scene", "room", "--duration", "5.5", "--laps", "0.4", "--quiet"]) == 0
    options = argparse.Namespace(calibration=None, skip_bad=False, truth=None, truth_body=None)
    return rigs.message_list(asl.load_asl(folder, options))


def judge(path, entries):
    return make_report(rigs.write(str(path), entries), "rig", argparse.Namespace(**OPTIONS))


def exchange(entries):
    for entry in rigs.of(entries, *SIDES):
        entry[0] = entry[0].replace("left", "?").replace("right", "left").replace("?", "right")
    return entries


def bend(image):
    """As a lens sees it that camera_info says nothing of."""
    rows, columns = image.shape
    K = np.array([[400.0, 0, 0.5 * columns], [0, 400.0, 0.5 * rows], [0, 0, 1.0]])
    turn = cv2.Rodrigues(np.array([0.02, 0.0, 0.03]))[0]
    maps = cv2.initUndistortRectifyMap(K, np.array([0.25, 0.1, 0, 0, 0]), turn, K, (columns, rows), cv2.CV_32FC1)
    return cv2.remap(image, *maps, cv2.INTER_LINEAR)


def raw_camera_info(entries):
    for _, _, info in rigs.of(entries, "/left/camera_info", "/right/camera_info"):
        info.D = [-0.3, 0.08, 0.0, 0.0, 0.0]
        sign = 1.0 if "left" in info.header.frame_id else -1.0
        info.R = cv2.Rodrigues(np.array([0.02 * sign, 0.0, 0.01 * sign]))[0].ravel().tolist()
    return entries


def small(image):
    return cv2.resize(image, None, fx=0.5, fy=0.5)


def both(entries, change):
    return rigs.change_pictures(rigs.change_pictures(entries, "left", change), "right", change)


def broken_files(entries):
    for _, _, message in rigs.of(entries, *SIDES):
        message.data = message.data[:20]
    return entries


def some_empty(entries):
    for _, _, message in rigs.of(entries, *SIDES)[::9]:
        message.data = b""
    return entries


def lens(model, count):
    def change(left, right):
        for info in (left, right):
            info.distortion_model, info.D = model, [0.01] * count
    return lambda entries: breaking.infos(entries, change)


def no_size(left, right):
    left.width = left.height = right.width = right.height = 0


def binned(left, right):
    left.binning_x = right.binning_x = 2


FAULTS = {
    "fisheye of five": (RED, "left/camera_info: D does not fit its model", lens("equidistant", 5)),
    "plumb_bob of three": (RED, "left/camera_info: D does not fit its model", lens("plumb_bob", 3)),
    "rational_polynomial of thirteen": (RED, "left/camera_info: D does not fit its model", lens("rational_polynomial", 13)),
    "unknown lens": (RED, "left/camera_info: distortion_model is unknown", lens("brown_conrady", 5)),
    "binned": (RED, "left/camera_info has binning or a region of interest", lambda e: breaking.infos(e, binned)),
    "no size": (RED, "left/camera_info does not say how large its pictures are", lambda e: breaking.infos(e, no_size)),
    "sent twice": (RED, "/left/image/compressed repeats what it has sent", lambda e: breaking.sent_twice(e, *SIDES)),
    "exchanged": (RED, "left and right pictures are exchanged", exchange),
    "not rectified": (RED, "matched points lie in different rows", lambda e: rigs.change_pictures(e, "right", bend)),
    "rows shifted": (RED, "matched points lie in different rows", lambda e: rigs.change_pictures(e, "right", lambda i: np.roll(i, 6, 0))),
    "rectified already": (RED, "the pictures are rectified already", raw_camera_info),
    "lens cap": (RED, "right pictures are black", lambda e: rigs.change_pictures(e, "right", lambda i: i // 20)),
    "overexposed": (RED, "left pictures are overexposed", lambda e: rigs.change_pictures(e, "left", lambda i: np.maximum(i, 240))),
    "mirrored": (RED, "left and right pictures do not show the same", lambda e: rigs.change_pictures(e, "right", lambda i: np.ascontiguousarray(i[:, ::-1]))),
    "not decoded": (RED, "pictures cannot be decoded", broken_files),
    "some not decoded": (YELLOW, "some pictures cannot be decoded", some_empty),
    "other size": (RED, "pictures and camera_info are of two sizes", lambda e: both(e, small)),
    "not paired": (RED, "left and right pictures are not pairs", lambda e: rigs.shift_stamps(e, 0.02, RIGHT)),
    "out of focus": (RED, "left and right pictures are not equally sharp",
                     lambda e: rigs.change_pictures(e, "right", rigs.blurred)),
    "darker": (YELLOW, "left and right pictures are not equally bright", lambda e: rigs.change_pictures(e, "right", lambda i: i // 3 + 12)),
    "camera late": (RED, "the camera's stamps are 4", lambda e: rigs.shift_stamps(e, 0.04, *SIDES)),
}


@pytest.mark.parametrize("name", list(FAULTS))
def test_the_fault_is_named_first(name, room, tmp_path):
    level, words, breaking = FAULTS[name]
    report = judge(tmp_path / "broken.bag", breaking(rigs.copies(room)))
    first = report.first
    assert first is not None and first.level == level and words in first.text, report.findings
    assert first.advice


def test_run_bag_names_the_cause_in_its_last_words(room, tmp_path):
    """Where it makes no pose, on standard error."""
    for change, words in (
            (FAULTS["exchanged"][2], "images: left and right look exchanged: "),
            (FAULTS["other size"][2], "left picture: not of camera_info's size"),
            (FAULTS["not paired"][2], "differ by more than 0.005 s (front_end/pair_tolerance_s)"),
            (lambda entries: rigs.without(entries, RIGHT), "there is no /right/image"),
            (lambda entries: breaking.no_stamp(entries, "/imu"), "imu: stamp is zero")):
        entries = change(rigs.copies(room))
        done = rigs.run_bag(rigs.write(str(tmp_path / "changed.bag"), entries), str(tmp_path / "run"))
        assert done.returncode == 2 and done.stderr.count("\n") == 1 and words in done.stderr, (words, done.stderr)


def fill_up(model, count):
    def change(left, right):
        for info in (left, right):
            info.distortion_model, info.D = model, [0.01] * 4 + [0.0] * (count - 4)
    return change


@pytest.mark.parametrize("model, count", [("rational_polynomial", 12), ("rational_polynomial", 14), ("equidistant", 5)])
def test_lenses_may_have_coefficients_of_zero_too_many(model, count, room, tmp_path):
    """As drivers fill them up: what is stated is then judged by the pictures."""
    report = judge(tmp_path / "lens.bag", breaking.infos(rigs.copies(room), fill_up(model, count)))
    assert "camera_info" in {f.check for f in report.of_level(GREEN)}, report.findings
    assert "stereo" in {f.check for f in report.findings if f.figure}, report.findings


def not_stated(left, right):
    for info in (left, right):
        info.distortion_model, info.K = "", [0.0] * 9


def test_rectified_pictures_need_neither_K_nor_a_model(room, tmp_path):
    report = judge(tmp_path / "bare.bag", breaking.infos(rigs.copies(room), not_stated))
    assert report.first is None, report.findings


def test_nothing_is_wrong_with_a_sound_rig(room, tmp_path):
    report = judge(tmp_path / "sound.bag", room)
    assert report.first is None
    assert {"pairs", "pictures", "one moment", "stereo", "gyro", "rotation", "time offset"} <= {f.check for f in report.of_level(GREEN)}
