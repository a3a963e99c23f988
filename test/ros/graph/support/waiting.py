"""Waits by wall time, since simulated time may stand still."""

import time


def wait_for(condition, seconds=20.0):
    """Whether `condition()` came true in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True
