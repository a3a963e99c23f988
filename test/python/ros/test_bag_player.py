"""What the player's process is tied to, and how it waits for a node that cannot follow."""

import os
import signal
import subprocess
import sys

import pytest
import rosbag
import rospy
from sensor_msgs.msg import Imu

from conftest import HANG_S
from vi_ekf_slam.ros.bag_player import ANSWER_LIMIT_S, LEAD_S, Player, Progress, ending_with, limited, number
from vi_ekf_slam.ros.private_ros import ros_master
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


@pytest.mark.parametrize("rate, max_delay_s, played", [(4.0, 10.0, 4.0), (1e9, 10.0, 50.0), (0.1, 0.0, 0.1)])
def test_a_rate_at_which_messages_would_be_lost_is_lowered(monkeypatch, rate, max_delay_s, played):
    heard = []
    monkeypatch.setattr(rospy, "logwarn", lambda *_: heard.append("warn"))
    assert limited(rate, max_delay_s) == played
    assert heard == (["warn"] if played < rate else [])


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


def test_progress_is_the_last_answer_in_the_times_of_the_bag():
    progress = Progress(20.0)
    assert progress.answered(clock=1000.0, now=0.0) == 1000.0  # a node that has not begun is not waited for
    progress.on_answer(stamp=50.0, clock=1003.0, now=1.0)
    progress.on_answer(stamp=51.0, clock=1002.0, now=1.0)  # the least between the two: nothing waited then
    progress.on_answer(stamp=60.0, clock=1090.0, now=2.0)
    assert progress.answered(clock=1090.0, now=2.0) == 1011.0


def test_a_silent_node_is_waited_for_no_longer_than_the_limit():
    progress = Progress(20.0)
    progress.on_answer(stamp=50.0, clock=1000.0, now=1.0)
    assert progress.answered(clock=1025.0, now=1.0 + ANSWER_LIMIT_S) == 1000.0
    assert progress.answered(clock=1025.0, now=1.1 + ANSWER_LIMIT_S) == 1025.0
    assert progress.answered(clock=1040.0, now=1.1 + ANSWER_LIMIT_S) == 1025.0
    progress.on_answer(stamp=90.0, clock=1040.0, now=30.0)  # it answers again, and has nothing left
    assert progress.answered(clock=1070.0, now=30.0) == 1040.0


# A node that answers each message of the imu at its own speed, and what waits in it. Everything else is as slam.launch has it.
PLAYS = """
import sys, threading, time, types
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu
from std_srvs.srv import SetBool
import rosservice
from vi_ekf_slam.ros import bag_player

path, pace, answers, pause = sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
bag_player.ANSWER_LIMIT_S, bag_player.QUIET_S = 1.0, 1.0
rospy.init_node("play_bag")
odometry = rospy.Publisher("odometry", Odometry, queue_size=1000)
waiting, most, heard, paused = [], [0], [0], []


def on_imu(message):
    waiting.append(message.header)
    heard[0] += 1
    most[0] = max(most[0], len(waiting))


def node():
    answered = 0
    while True:
        time.sleep(pace)
        if waiting and answered < answers:
            odometry.publish(Odometry(header=waiting.pop(0)))
            answered += 1


def pause_for(seconds):
    # The master still knows those of players that were killed; their names end in the time of their start.
    service = max(name for name in rosservice.get_service_list() if name.endswith("/pause_playback"))
    set_pause = rospy.ServiceProxy(service, SetBool)
    assert set_pause(True).success
    time.sleep(seconds)
    assert set_pause(False).success
    paused.append(True)


listener = rospy.Subscriber("imu", Imu, on_imu, queue_size=None)
threading.Thread(target=node, daemon=True).start()
bag = types.SimpleNamespace(path=path, played=["/imu"], unheard=[], imu_frame="imu", goal=rospy.Time(1059),
                            end=rospy.Time(1059), duration=59.0)
with bag_player.Player(bag, "/slam", 100.0 if not pause else 10.0, []) as player:
    while not player.is_over():
        assert player.process.poll() is None
        player.tell_progress()
        if pause and heard[0] and player.answered.to_sec() > 1005.0:
            threading.Thread(target=pause_for, args=[pause], daemon=True).start()
            pause = 0.0
        time.sleep(0.02)
print("RESULT", heard[0], most[0], player.answered >= bag.goal, bool(paused))
"""


@pytest.fixture(scope="module")
def play(tmp_path_factory):
    """A function that plays 59 s of a 20 Hz imu. It returns how many messages came, how many waited at most, whether the last was
    answered, and whether the player was paused."""
    folder = tmp_path_factory.mktemp("play")
    path = str(folder / "imu.bag")
    with rosbag.Bag(path, "w") as bag:
        for i in range(1181):
            message = Imu()
            message.header.stamp = rospy.Time.from_sec(1000.0 + i / 20.0)
            bag.write("/imu", message, message.header.stamp)

    with ros_master(str(folder)) as environment:
        def run(pace, answers=10000, pause=0.0):
            done = subprocess.run([sys.executable, "-c", PLAYS, path, str(pace), str(answers), str(pause)], env=environment,
                                  stdout=subprocess.PIPE, timeout=HANG_S, check=True)
            result = next(line for line in done.stdout.decode().splitlines() if line.startswith("RESULT")).split()
            return int(result[1]), int(result[2]), result[3] == "True", result[4] == "True"
        yield run


def test_waits_for_a_node_that_cannot_follow(play):
    heard, most, is_answered, _ = play(pace=0.004)  # 250 messages a second; the bag brings 2000
    assert heard == 1181 and is_answered
    assert most < 20 * (2.0 * LEAD_S + 1.0)  # of all 1181


@pytest.mark.parametrize("answers", [0, 200])
def test_does_not_wait_for_ever_for_a_node_that_answers_no_more(play, answers):
    heard, _, is_answered, _ = play(pace=0.0001, answers=answers)
    assert heard == 1181 and not is_answered


def test_a_bag_that_is_paused_is_not_over(play):
    heard, _, is_answered, is_paused = play(pace=0.0001, pause=4.0)
    assert heard == 1181 and is_answered and is_paused
