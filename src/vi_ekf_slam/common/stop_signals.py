"""End by an exception on the signals that ask a program to stop, so that its clean-up runs."""

import contextlib
import signal

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_received = []
_holds = []


@contextlib.contextmanager
def signals_unwind():
    """Inside the block SIGINT, SIGTERM and SIGHUP end the program by an exception, so that clean-up runs."""
    def stop(signum, _frame):
        for number in STOP_SIGNALS:  # the clean-up itself must not be interrupted
            signal.signal(number, signal.SIG_IGN)
        _received.append(signum)
        if not _holds:
            raise SystemExit(128 + signum)

    previous = [(number, signal.signal(number, stop)) for number in STOP_SIGNALS]
    try:
        yield
    finally:
        _received.clear()
        for number, handler in previous:
            signal.signal(number, handler)


@contextlib.contextmanager
def signals_wait():
    """Inside the block such a signal does nothing yet; it ends the program at the block's end.

    So that what is begun inside, as a process that is started, is known to what cleans up.
    """
    _holds.append(True)
    try:
        yield
    finally:
        _holds.pop()
    end_if_told()


def end_if_told():
    """SystemExit again where one of the signals came in the block and the exception was swallowed.

    rospy catches everything at some places. Loops that use it within `signals_unwind` call this.
    """
    if _received:
        raise SystemExit(128 + _received[0])
