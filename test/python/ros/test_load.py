"""A short load through real topics; scripts/load_test.py alone runs the long one."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import HANG_S, process, script, script_path

from vi_ekf_slam.ros.load_test import DROPS, Street, account


def test_400_hz_imu_and_30_hz_features_nothing_lost_unreported():
    """Whatever namespace the caller's shell has."""
    done = process("load_test.py", "--duration", 6, "--limit", 3, environment=dict(os.environ, ROS_NAMESPACE="robot1"))
    assert done.returncode == 0, done.stdout + done.stderr
    rows = {row[0]: [int(x) for x in row[1:]] for row in re.findall(
        r"^(imu|velocity|features) +(\d+) +(\d+) +(\d+) +(\d+)$", done.stdout, re.MULTILINE)}
    assert rows["imu"][0] == 2400 and rows["features"][0] == 180
    assert all(row[3] == 0 for row in rows.values())
    assert rows["features"][1] > 0
    assert "queue is full" not in done.stdout  # IMU and velocity are never shed


@pytest.mark.parametrize("option, value", [
    ("--duration", "0"), ("--duration", "nan"), ("--frame-rate", "0"), ("--imu-rate", "nan"), ("--features", "-1"), ("--limit", "-1")])
def test_what_cannot_be_is_refused(option, value):
    done = script("load_test.py", "%s=%s" % (option, value))
    assert done.returncode == 2 and "%s is %s" % (option, value) in done.stderr and done.stderr.count("\n") == 1, done.stderr


def children(pid):
    """Of all that runs, what `pid` has started, and what that has."""
    try:
        with open("/proc/%d/task/%d/children" % (pid, pid), encoding="ascii") as stream:
            own = [int(word) for word in stream.read().split()]
    except FileNotFoundError:  # it has ended meanwhile
        return []
    return own + [grandchild for child in own for grandchild in children(child)]


def test_nothing_is_left_running_when_it_is_told_to_stop():
    test = subprocess.Popen([sys.executable, script_path("load_test.py"), "--duration", "600"], stdout=subprocess.DEVNULL)
    end = time.monotonic() + HANG_S
    while len(children(test.pid)) < 3:  # roscore with its master and rosout, or the node
        assert test.poll() is None and time.monotonic() < end
        time.sleep(0.1)
    started = children(test.pid)
    test.send_signal(signal.SIGTERM)
    assert test.wait(HANG_S) == 128 + signal.SIGTERM
    assert not [pid for pid in started if os.path.exists("/proc/%d" % pid)]


def test_what_is_neither_processed_nor_counted_is_found():
    streams = ("gyro", "velocity", "stereo")
    summary = dict({key: dict.fromkeys(streams, 1) for key in DROPS}, processed=dict.fromkeys(streams, 90),
                   turned_away={"features: message shed, too old for the load": 3, "features: repeated id": 50})
    rows = account(dict.fromkeys(streams, 100), summary)
    assert rows == [("imu", 100, 90, 5, 5), ("velocity", 100, 90, 5, 5), ("features", 100, 90, 8, 2)]


@pytest.mark.parametrize("elapsed", [0.0, 7.0])
def test_the_street_is_rigid_and_fills_the_frame(elapsed):
    ids, pixels = Street(300).observe(elapsed)
    assert len(ids) == len(set(ids.tolist())) == 300
    assert (pixels[:, 0] > pixels[:, 2]).mean() > 0.99
    again, _ = Street(300).observe(elapsed + 1.0 / 30.0)
    assert len(np.intersect1d(ids, again)) > 200
