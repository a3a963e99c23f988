"""check_rig.py as a program: what it prints, writes and ends with; and live."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest
import rigs
from conftest import script_path

from vi_ekf_slam.rig_check.checker import all_checks, main
from vi_ekf_slam.rig_check.finding import RED, UNJUDGED, Report
from vi_ekf_slam.rig_check.output import text, verdict
from vi_ekf_slam.ros.private_ros import child, ros_master


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A bag of a sound rig."""
    return rigs.write(str(tmp_path_factory.mktemp("rig") / "sound.bag"), rigs.message_list(rigs.shaken_points()))


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    """A bag without transforms."""
    entries = rigs.without(rigs.message_list(rigs.shaken_points()), "/tf_static")
    return rigs.write(str(tmp_path_factory.mktemp("rig") / "broken.bag"), entries)


def test_status_and_verdict_tell_a_sound_rig_from_a_broken_one(sound, broken, capsys):
    assert main([sound, "--quiet", "imu:=/imu", "--without-load"]) == 0
    assert capsys.readouterr().out == "Nothing is wrong with this rig, as far as could be judged; not judged: pairs, pictures.\n"
    assert main([broken, "--quiet", "--without-load"]) == 1
    assert capsys.readouterr().out.startswith("First: no transform from 'imu_link' to 'left_camera_optical'")


def test_the_load_is_measured_with_run_bag(sound, capsys):
    assert main([sound]) == 0
    assert "% of a core for" in " ".join(capsys.readouterr().out.split())


def test_the_page_is_one_file_with_all_findings_and_pictures(broken, tmp_path, capsys):
    folder = tmp_path / "new" / "report"
    assert main([broken, "--without-load", "--html", str(tmp_path / "rig.html"), "--output", str(folder)]) == 1
    printed = capsys.readouterr().out
    page = (tmp_path / "rig.html").read_text()
    assert page == (folder / "rig.html").read_text() and (folder / "rig.txt").read_text().split() == printed.split()
    root = ElementTree.fromstring(page.replace("<!DOCTYPE html>\n", ""))
    assert "no transform from" in "".join(root.itertext())
    pictures = [image.get("src") for image in root.iter("img")]
    assert len(pictures) >= 5 and all(source.startswith("data:image/png;base64,") for source in pictures)
    assert "http" not in page.replace("http-equiv", "")


def test_what_follows_from_a_fault_is_not_judged(broken, capsys):
    assert main([broken, "--without-load"]) == 1
    lines = " ".join(capsys.readouterr().out.split())
    assert "1 red, 0 yellow" in lines and "not judged: follows from: no transform" in lines


def test_each_check_needs_only_what_comes_before_it():
    names = [check.name for check in all_checks()]
    assert len(set(names)) == len(names)
    for k, check in enumerate(all_checks()):
        assert set(check.needs) <= set(names[:k]), check.name


def test_a_fault_hides_all_that_rests_on_it():
    report = Report("rig")
    assert report.begin("a", ())
    report.red("a is broken", "1", "2", "mend a")
    assert not report.begin("b", ("a",)) and not report.begin("c", ("b",)) and report.begin("d", ())
    assert [finding.level for finding in report.findings] == [RED, UNJUDGED, UNJUDGED]
    assert report.first.text == "a is broken" and "First: a is broken (1; allowed: 2). Mend a." in text(report)


def test_a_question_ends_the_verdict_as_it_is():
    report = Report("rig")
    report.begin("a", ())
    report.red("a is broken", "1", "2", "is b there?")
    assert verdict(report) == "First: a is broken (1; allowed: 2). Is b there?"


@pytest.mark.parametrize("arguments, complaint", [
    ((), "0 bags are given, allowed: one"),
    (("a.bag", "b.bag"), "2 bags are given"),
    (("--live", "5", "a.bag"), "1 bags are given, allowed: one, or none with --live"),
    (("--live", "0"), "--live is 0 s, allowed: finite and above 0"),
    (("{sound}", "--duration", "-1"), "--duration is -1"),
    (("{sound}", "camera:=/x"), "'camera:=/x', allowed: NAME:=TOPIC with NAME of"),
    (("missing.bag",), "missing.bag: no such file"),
    (("{broken_file}",), "cannot be read as a bag"),
    (("{sound}", "--imu-noise", "missing.yaml"), "missing.yaml: cannot be read"),
    (("{sound}", "--html", "/nowhere/rig.html"), "the directory /nowhere does not exist"),
    (("{sound}", "--html", "{sound}"), "is the input itself")])
def test_what_cannot_be_used_is_refused_with_status_2(arguments, complaint, sound, tmp_path, capsys):
    garbage = tmp_path / "garbage.bag"
    garbage.write_bytes(open(sound, "rb").read()[:5000])
    words = [word.format(sound=sound, broken_file=garbage) for word in arguments]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and complaint in error and error.count("\n") == 1


def test_an_empty_bag_is_refused(tmp_path, capsys):
    path = rigs.write(str(tmp_path / "empty.bag"), [])
    assert main([path]) == 2
    assert "holds no message" in capsys.readouterr().err


def test_noise_is_judged_by_a_calibration(sound, tmp_path, capsys):
    noise = tmp_path / "imu.yaml"
    noise.write_text("gyroscope_noise_density: 1.7e-06\ngyroscope_random_walk: 2.0e-5\naccelerometer_noise_density: 2.0e-3\n"
                     "accelerometer_random_walk: 3.0e-3\nupdate_rate: 200.0\n")
    assert main([sound, "--without-load", "--quiet", "--imu-noise", str(noise)]) == 0
    assert "Usable; to be better: the gyro is noisier than it states" in capsys.readouterr().out


def test_live_topics_are_judged(sound, tmp_path):
    with ros_master(str(tmp_path)) as environment:
        play = ["rosbag", "play", "--quiet", "--loop", "--rate", "1", sound]
        command = [sys.executable, script_path("check_rig.py"), "--without-load", "--live"]
        silent = subprocess.run(command + ["0.5"], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                universal_newlines=True, timeout=120)
        assert silent.returncode == 2 and "no topic of a rig is published" in silent.stderr
        with child(play, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL):
            _wait_for("/imu", environment)
            done = subprocess.run(command + ["2.5"], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                  universal_newlines=True, timeout=120)
    assert "live, 2.5 s" in done.stdout and "all required topics are there" in done.stdout, done.stdout + done.stderr
    # The rig's time is that of its recording, long ago, on all topics alike.
    assert "two clocks" not in done.stdout and "matched points lie in one row" in done.stdout


SILENT = "import rospy; from sensor_msgs.msg import Imu; rospy.init_node('silent'); p = rospy.Publisher('/imu', Imu); rospy.spin()"


def test_live_topics_on_which_nothing_is_published_are_refused(tmp_path):
    with ros_master(str(tmp_path)) as environment, open(os.devnull, "wb") as null:
        with child([sys.executable, "-W", "ignore", "-c", SILENT], env=environment, stdin=subprocess.DEVNULL, stdout=null, stderr=null):
            _wait_for("/imu", environment)
            done = subprocess.run([sys.executable, script_path("check_rig.py"), "--live", "0.5"], env=environment, stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE, universal_newlines=True, timeout=120)
    assert done.returncode == 2 and done.stderr == "error: nothing was published in 0.5 s on /imu, at %s (ROS_MASTER_URI)\n" % (
        environment["ROS_MASTER_URI"]), done.stderr


def _wait_for(topic, environment):
    import time

    from vi_ekf_slam.ros.private_ros import published_topics
    end = time.monotonic() + 60.0
    while topic not in published_topics(environment):
        assert time.monotonic() < end
        time.sleep(0.1)


def test_without_a_master_live_is_refused():
    environment = dict(os.environ, ROS_MASTER_URI="http://localhost:1")
    done = subprocess.run([sys.executable, script_path("check_rig.py"), "--live", "1"], env=environment, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, universal_newlines=True, timeout=120)
    assert done.returncode == 2 and "no ROS master answers at http://localhost:1" in done.stderr
