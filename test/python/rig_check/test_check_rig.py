"""Broken rigs of features and an IMU: the fault is named first, and nothing is wrong with those that are sound."""

import argparse
import functools

import genpy
import numpy as np
import pytest
import rigs
from breaking import (accelerations, backwards, burst, every, exchange_infos, exchanged, extrinsic, features,
                      foreign_gyro, gyro, half_resolution, infos, late, looping, losing, losing_some,
                      matrices_of_half_resolution, no_stamp, not_a_number, not_a_pair, one_above_the_other, one_frame,
                      other_rows, quiet_statement, renamed, repeated, scale_baseline, sent_twice, turned_imu, two_imus,
                      with_P, wrong_focal_length)

from vi_ekf_slam.common.geometry import inverse, make_transform, quaternion_to_rotation, so3_exp, so3_log
from vi_ekf_slam.rig_check.checker import make_report
from vi_ekf_slam.rig_check.finding import GREEN, RED, UNJUDGED, YELLOW


@pytest.fixture(scope="module")
def sound():
    """{whether it has a velocity: entries}."""
    return {with_velocity: rigs.message_list(rigs.shaken_points(with_velocity)) for with_velocity in (False, True)}


def judge(path, entries, *remap, **changes):
    options = dict(remap=list(remap), duration=0.0, imu_noise=None, without_load=True)
    return make_report(rigs.write(str(path), entries), "rig", argparse.Namespace(**dict(options, **changes)))


ROLL = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
C = rigs.IMU_T_LEFT
# name: (level, words of the first finding, what breaks the rig, whether it has a velocity).
FAULTS = {
    "no IMU": (RED, "nothing comes on /imu", lambda e: rigs.without(e, "/imu"), True),
    "no camera_info": (RED, "nothing comes on /right/camera_info", lambda e: rigs.without(e, "/right/camera_info"), False),
    "no pictures": (RED, "nothing comes on /left/image", lambda e: rigs.without(e, "/features"), False),
    "no acceleration, no velocity": (RED, "nothing comes on /velocity", lambda e: accelerations(e, lambda a: 0.0 * a), False),
    "other name": (YELLOW, "/imu is taken from /mavros/imu/data", lambda e: renamed(e, "/imu", "/mavros/imu/data"), False),
    "NaN": (RED, "linear_acceleration of /imu is NaN", lambda e: every(e, 7, not_a_number), False),
    "negative sigma": (RED, "sigma of /features is negative, NaN or infinite", lambda e: features(e, lambda f: setattr(f, "sigma", -1.0)), False),
    "huge sigma": (RED, "sigma of /features is beyond what any point has", lambda e: features(e, lambda f: setattr(f, "sigma", 1000.0)), False),
    "one id": (RED, "ids repeat within a message of /features", lambda e: features(e, lambda f: setattr(f, "id", f.id // 2)), False),
    "no stamps": (RED, "header.stamp of /features is zero", no_stamp, False),
    "repeated stamps": (RED, "stamps repeat on /imu", repeated, False),
    "a bag that loops": (RED, "time runs back on", looping, False),
    "two clocks": (RED, "/imu and /features have two clocks", lambda e: rigs.shift_stamps(e, -1e6, "/features"), False),
    "late": (RED, "/features comes 0.4 s later after its stamp", lambda e: late(e, "/features", lambda t: 0.4), False),
    "gaps": (RED, "/imu has gaps", losing, False),
    "holes": (YELLOW, "/imu has gaps", losing_some, False),
    "bursts": (YELLOW, "/imu stutters", burst, False),
    "in g": (RED, "accelerations are in g", lambda e: accelerations(e, lambda a: a / 9.80665), False),
    "without gravity": (RED, "gravity is missing", lambda e: accelerations(e, lambda a: 0.1 * (a - [0, 0, 9.81])), False),
    "camera_info exchanged": (RED, "left and right camera_info are exchanged", lambda e: infos(e, exchange_infos), False),
    "camera_info of single cameras": (RED, "camera_info is not of a rectified pair", lambda e: infos(e, not_a_pair), False),
    "one above the other": (RED, "the cameras are one above the other", lambda e: infos(e, one_above_the_other), False),
    "vertical part": (RED, "the baseline has a vertical part", lambda e: infos(e, with_P("right", P7=-3.0)), False),
    "right camera on the left": (RED, "camera_info states that the right camera is on the left",
                                 lambda e: infos(e, with_P("right", P3=80.0)), False),
    "skewed": (RED, "right/camera_info: P is none of a rectified camera", lambda e: infos(e, with_P("right", P1=1.0)), False),
    "P of zeros": (RED, "right/camera_info: P is none of a rectified camera", lambda e: infos(e, with_P("right", P10=0.0)), False),
    "sent twice": (RED, "/features repeats what it has sent", lambda e: sent_twice(e, "/features"), False),
    "two IMUs": (RED, "nothing comes on /imu", two_imus, False),
    "pixel noise": (YELLOW, "pixel noise is larger than stated",
                    lambda e: features(e, lambda f: setattr(f, "sigma", 0.5 * f.sigma)), False),
    "no transform": (RED, "no transform from 'imu_link' to 'left_camera_optical'", lambda e: rigs.without(e, "/tf_static"), False),
    "one frame": (RED, "IMU and left camera are said to be one frame", one_frame, False),
    "left and right exchanged": (RED, "disparity has the wrong sign", lambda e: features(e, exchanged), False),
    "not rectified": (RED, "matched points lie in different rows", lambda e: features(e, other_rows), False),
    "deg/s": (RED, "the gyro is in deg/s", lambda e: gyro(e, np.degrees), False),
    "deg/s, turned fast": (RED, "the gyro is in deg/s", lambda e: gyro(e, lambda w: np.degrees(4.0 * w)), False),
    "rad/s twice": (RED, "the gyro is converted to rad/s twice", lambda e: gyro(e, np.radians), False),
    "mirrored gyro": (RED, "an axis of the gyro has the wrong sign", lambda e: gyro(e, lambda w: w * [1, -1, 1]), False),
    "wrong focal length": (YELLOW, "gyro and camera differ in how fast they turn", lambda e: infos(e, wrong_focal_length), False),
    "other resolution": (RED, "features lie outside of the picture", lambda e: infos(e, half_resolution), False),
    "dead gyro": (RED, "the gyro does not move while the camera turns", lambda e: gyro(e, lambda w: 0.0 * w), False),
    "gyro of another body": (RED, "gyro and camera do not turn together",
                  foreign_gyro, False),
    "inverted": (RED, "it looks inverted", lambda e: extrinsic(e, inverse(C)), False),
    "left out": (RED, "it looks left out", lambda e: extrinsic(e, make_transform(np.eye(3), C[:3, 3])), False),
    "axes exchanged": (RED, "x, y, z of the transform are the IMU's -y, x, z", lambda e: turned_imu(e, ROLL.T), False),
    "turned": (RED, "imu -> camera is off by 9.", lambda e: extrinsic(e, C @ make_transform(so3_exp([0.1, -0.1, 0.1]), np.zeros(3))), False),
    "camera late": (RED, "the camera's stamps are 30 ms late", lambda e: rigs.shift_stamps(e, 0.03, "/features"), False),
    "camera early": (RED, "the camera's stamps are 60 ms early", lambda e: rigs.shift_stamps(e, -0.06, "/features"), False),
    "negative accelerations": (RED, "accelerations have the wrong sign", lambda e: accelerations(e, lambda a: -a), False),
    "baseline, by the accelerometer": (RED, "the scale of the baseline does not fit the accelerometer",
                                       lambda e: infos(e, scale_baseline(1.25)), False),
    "baseline, by the velocity": (RED, "the scale of the baseline does not fit the velocity", lambda e: infos(e, scale_baseline(0.8)), True),
    "backwards": (RED, "the camera does not travel where the velocity points", backwards, True),
    "noise": (YELLOW, "the gyro is noisier than it states", quiet_statement, False),
}


@pytest.fixture(scope="module")
def report_of(sound, tmp_path_factory):
    """The report of the rig with a fault of FAULTS, made once."""
    @functools.lru_cache(maxsize=None)
    def report(name):
        _, _, breaking, with_velocity = FAULTS[name]
        return judge(tmp_path_factory.mktemp("fault") / "broken.bag", breaking(rigs.copies(sound[with_velocity])))
    return report


@pytest.mark.parametrize("name", list(FAULTS))
def test_the_fault_is_named_first(name, report_of):
    level, words, _, _ = FAULTS[name]
    report = report_of(name)
    first = report.first
    assert first is not None and first.level == level and words in first.text, report.findings
    assert first.figure or first.limit
    assert first.advice


def test_matrices_of_another_resolution_than_the_size_are_told(sound, tmp_path):
    """Whatever else follows from it."""
    report = judge(tmp_path / "half.bag", infos(rigs.copies(sound[False]), matrices_of_half_resolution))
    assert any("the principal point is far from the middle" in finding.text for finding in report.of_level(YELLOW)), report.findings


def test_of_two_imus_both_are_named_and_none_is_missed_where_a_topic_is_given(sound, tmp_path):
    entries = two_imus(rigs.copies(sound[False]))
    assert judge(tmp_path / "two.bag", entries).first.advice == "name the topic: imu:=/imu_1 or imu:=/imu_2"
    assert judge(tmp_path / "two.bag", entries, "imu:=/imu_2").first is None
    assert judge(tmp_path / "two.bag", entries, "imu:=/none").first is None  # the camera alone


def test_a_transform_that_was_recorded_long_before_is_no_beginning(sound, tmp_path):
    entries = rigs.copies(sound[False])
    rigs.of(entries, "/tf_static")[0][1] = genpy.Time(1)
    assert judge(tmp_path / "early.bag", entries, duration=60.0).first is None


def test_a_transform_without_a_rotation_is_named(sound, tmp_path):
    entries = rigs.copies(sound[False])
    rigs.of(entries, "/tf_static")[0][2].transforms[0].transform.rotation.w = np.nan
    first = judge(tmp_path / "none.bag", entries).first
    assert "no transform from 'imu_link'" in first.text and "(not finite, or no unit quaternion)" in first.figure


@pytest.mark.parametrize("factor", [10.0, 1000.0])
@pytest.mark.parametrize("with_velocity", [False, True])
def test_a_baseline_that_is_stated_far_too_long_is_told(sound, with_velocity, factor, tmp_path):
    """What is scaled wrongly has errors of that scale: they hide the fault no more than a small one."""
    findings = judge(tmp_path / "broken.bag", infos(rigs.copies(sound[with_velocity]), scale_baseline(factor))).findings
    told = [finding for finding in findings if finding.check == "scale" and finding.level == RED]
    assert told and "the scale of the baseline does not fit" in told[0].text, findings


@pytest.mark.parametrize("with_velocity", [False, True])
def test_nothing_is_wrong_with_a_sound_rig(sound, with_velocity, tmp_path):
    report = judge(tmp_path / "sound.bag", sound[with_velocity])
    assert report.first is None
    judged = {finding.check for finding in report.of_level(GREEN)}
    assert {"topics", "clocks", "one moment", "stereo", "gyro", "rotation", "time offset", "scale", "noise", "gyro bias"} <= judged


@pytest.mark.parametrize("late", [0.005, -0.02])
def test_cameras_that_are_not_exposed_at_once_are_named_whatever_their_stamps(late, tmp_path):
    report = judge(tmp_path / "late.bag", rigs.message_list(rigs.shaken_points(right_late=late)))
    first = report.first
    assert first.level == RED and "right pictures are %s than left ones" % ("later" if late > 0.0 else "earlier") in first.text
    assert float(first.figure.split()[0]) == pytest.approx(1e3 * abs(late), rel=0.25)
    assert [finding.advice for finding in report.findings if finding.check == "stereo"] == ["follows from: " + first.text]


def test_rows_that_differ_by_where_a_point_is_are_no_delay(sound, tmp_path):
    def change(f):
        f.v_right += 0.01 * (f.v_left - 200.0) + 1.0  # another focal length and a shift
    report = judge(tmp_path / "focal.bag", features(rigs.copies(sound[False]), change))
    assert not [finding for finding in report.findings if finding.check == "one moment" and finding.level != GREEN]


def test_nothing_is_wrong_where_frames_lie_between_samples_of_the_imu(tmp_path):
    """The last window needs the sample after its end."""
    report = judge(tmp_path / "between.bag", rigs.message_list(rigs.shaken_points(first_frame=0.0249)))
    assert report.first is None
    assert "scale" in {finding.check for finding in report.of_level(GREEN)}


@pytest.mark.parametrize("name", ["inverted", "left out", "turned", "axes exchanged"])
def test_the_rotation_that_is_told_mends_the_rig(name, report_of, sound, tmp_path):
    entries = FAULTS[name][2](rigs.copies(sound[False]))
    advice = report_of(name).first.advice.split()
    told = [float(word) for word in advice[advice.index("Z") + 1:][:4]]
    extrinsic(entries, make_transform(quaternion_to_rotation(told), C[:3, 3]))
    assert not [finding for finding in judge(tmp_path / "mended.bag", entries).findings if finding.check == "rotation" and finding.level != GREEN]


def test_the_offset_that_is_told_mends_the_rig(sound, tmp_path):
    entries = rigs.shift_stamps(rigs.copies(sound[False]), 0.045, "/features")
    words = judge(tmp_path / "broken.bag", entries).first.advice.replace(",", "").split()
    offset = float(words[words.index("calibration/time_offset:") + 1])  # to be added to the pictures' stamps
    assert offset == pytest.approx(-0.045, abs=0.003)
    assert judge(tmp_path / "mended.bag", rigs.shift_stamps(entries, offset, "/features")).first is None


WHEELS = dict(with_velocity=True, place=rigs.street, baseline=0.5)
STREET = dict(motion=rigs.RigOnWheels(15.0, 0.0), place=rigs.street, baseline=0.12)
# name: (options of rigs.shaken_points, checks that are green, checks that are not judged).
SOUND = {
    "short baseline": (dict(baseline=0.05, pixel_sigma=0.5), {"gyro", "rotation", "time offset", "scale"}, set()),
    "shorter baseline": (dict(baseline=0.02, pixel_sigma=0.5, frame_rate=30.0), {"gyro", "rotation", "time offset"}, set()),
    "60 Hz": (dict(frame_rate=60.0), {"gyro", "rotation", "time offset", "scale"}, set()),
    "flat floor": (dict(motion=rigs.RigOnWheels(0.0, 0.8), pixel_sigma=0.1), {"gyro", "time offset"}, {"rotation"}),
    "flat floor, other noise": (dict(motion=rigs.RigOnWheels(0.0, 0.8), pixel_sigma=0.1, seed=2), {"gyro", "time offset"}, {"rotation"}),
    "car in a bend": (dict(WHEELS, motion=rigs.RigOnWheels(10.0, 0.3), seed=2), {"gyro", "time offset", "scale"}, {"rotation"}),
    "car straight ahead, 60 Hz": (dict(STREET, frame_rate=60.0, pixel_sigma=0.7), set(), {"gyro", "rotation", "time offset"}),
    "car straight ahead, noise": (dict(STREET, with_velocity=True, frame_rate=30.0, pixel_sigma=1.0), set(), {"gyro", "rotation", "scale"}),
}


@pytest.mark.parametrize("name", list(SOUND))
def test_what_a_sound_rig_does_not_tell_is_not_judged(name, tmp_path):
    options, green, unjudged = SOUND[name]
    report = judge(tmp_path / "sound.bag", rigs.message_list(rigs.shaken_points(**options)))
    assert report.first is None, report.findings
    assert green <= {finding.check for finding in report.of_level(GREEN)}
    assert unjudged <= {finding.check for finding in report.of_level(UNJUDGED)}


def misalignment_of(imu_R_left):
    return np.linalg.norm(so3_log(imu_R_left @ C[:3, :3].T))


def test_a_rig_that_turns_about_one_axis_tells_what_is_wrong_about_the_others(tmp_path):
    """And only that: the transform that is told mends it."""
    tilt = make_transform(so3_exp([np.radians(20.0), 0.0, 0.0]), np.zeros(3))
    entries = extrinsic(rigs.message_list(rigs.shaken_points(motion=rigs.RigOnWheels(0.0, 0.8), pixel_sigma=0.1, seed=2)), tilt @ C)
    first = judge(tmp_path / "broken.bag", entries).first
    assert first.level == RED and "imu -> camera is off by 20" in first.text
    words = first.advice.split()
    told = quaternion_to_rotation([float(word) for word in words[words.index("Z") + 1:][:4]])
    assert np.linalg.norm(told[2] - C[2, :3]) < np.radians(0.5)  # the vertical in the camera
    assert misalignment_of(told) < np.radians(5.0)  # about the vertical noise alone moves it


def test_features_without_a_point_are_no_reason_to_warn(sound, tmp_path, recwarn):
    empty = every(rigs.copies(sound[False]), 1, lambda message: setattr(message, "features", []), "/features")
    report = judge(tmp_path / "empty.bag", empty)
    assert report.first.text == "features are empty" and [str(warning.message) for warning in recwarn] == []


def test_where_the_rig_hardly_turns_nothing_is_said_of_rotation_and_clocks(tmp_path):
    still = rigs.message_list(rigs.still_points())
    report = judge(tmp_path / "still.bag", still)
    assert not report.of_level(RED)
    assert {"gyro", "rotation", "time offset", "scale"} <= {finding.check for finding in report.findings if finding.level == UNJUDGED}
