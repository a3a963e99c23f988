"""Programs that are told to stop."""

import os
import signal

import pytest

from vi_ekf_slam.common.stop_signals import end_if_told, signals_unwind, signals_wait


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_is_swallowed_is_raised_again(number):
    """As by rospy, which catches everything while it is imported and connects."""
    with pytest.raises(SystemExit) as ended, signals_unwind():
        end_if_told()  # not told yet
        try:
            os.kill(os.getpid(), number)
        except SystemExit:
            pass
        end_if_told()
    assert ended.value.code == 128 + number


def test_of_the_block_before_nothing_is_left():
    with pytest.raises(SystemExit), signals_unwind():
        os.kill(os.getpid(), signal.SIGTERM)
    with signals_unwind():
        end_if_told()


def test_what_is_begun_is_known_before_the_program_ends():
    """As a process whose start a signal meets half-way."""
    begun = []
    with pytest.raises(SystemExit) as ended, signals_unwind():
        with signals_wait():
            os.kill(os.getpid(), signal.SIGTERM)
            begun.append("process")
        begun.append("more")
    assert ended.value.code == 128 + signal.SIGTERM and begun == ["process"]
    with signals_wait():
        pass  # nothing is left of it
