"""What the player's process is tied to."""

import os
import signal
import subprocess
import sys

import pytest
import rospy

from conftest import HANG_S
from vi_ekf_slam.ros.bag_player import Player, ending_with, number
from vi_ekf_slam.ros.recorded_bag import PlayError


def said_by(parent):
    done = subprocess.run(ending_with(parent, ["echo", "a b", "c"]), stdout=subprocess.PIPE, timeout=HANG_S)
    return done.returncode, done.stdout


def test_runs_as_the_child_of_its_parent():
    assert said_by(os.getpid()) == (0, b"a b c\n")


def test_does_not_run_where_the_parent_has_ended_meanwhile():
    assert said_by(os.getppid()) == (1, b"")


def test_ends_with_its_parent():
    start = ("import os, subprocess, sys, time; from vi_ekf_slam.ros.bag_player import ending_with;"
             "child = subprocess.Popen(ending_with(os.getpid(), ['sleep', '1000'])); print(child.pid, flush=True); time.sleep(1000)")
    with subprocess.Popen([sys.executable, "-c", start], stdout=subprocess.PIPE) as parent:
        child = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
        try:
            parent.communicate(timeout=HANG_S)  # until nobody holds the pipe that the child has too
        except subprocess.TimeoutExpired:
            os.kill(child, signal.SIGKILL)
            raise


@pytest.mark.parametrize("value, expected", [(2, 2.0), (0.5, 0.5), ("1e9", 1e9), (" 1.5 ", 1.5)])
def test_a_number_may_be_written_as_any_other(monkeypatch, value, expected):
    monkeypatch.setattr(rospy, "get_param", lambda _: value)
    assert number("rate", lambda x: x > 0.0, "a positive number") == expected


@pytest.mark.parametrize("value", [True, "fast", "", "nan", "-1e9", [1.0], {"a": 1.0}, None])
def test_what_is_no_number_is_refused(monkeypatch, value):
    monkeypatch.setattr(rospy, "get_param", lambda _: value)
    with pytest.raises(PlayError, match="~rate is .*, allowed: a positive number"):
        number("rate", lambda x: x > 0.0, "a positive number")


@pytest.mark.parametrize("is_held, answered, said", [
    (True, 0, ["info"]),  # a bag that is shorter than what the node waits for a stream that never comes
    (True, 3, ["warn"]), (False, 0, ["warn"])])
def test_only_what_should_have_been_answered_is_a_warning(monkeypatch, is_held, answered, said):
    heard = []
    monkeypatch.setattr(rospy, "loginfo", lambda *_: heard.append("info"))
    monkeypatch.setattr(rospy, "logwarn", lambda *_: heard.append("warn"))
    player = Player.__new__(Player)
    player.is_held, player.answered, player.goal = is_held, rospy.Time(answered), rospy.Time(5)
    player.tell_of_the_end()
    assert heard == said
