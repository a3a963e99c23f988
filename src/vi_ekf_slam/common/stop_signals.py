"""End by an exception on the signals that ask a program to stop, so that its clean-up runs."""

import contextlib
import signal

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def signals_unwind():
    """Inside the block SIGINT, SIGTERM and SIGHUP end the program by an exception, so that clean-up runs."""
    def stop(signum, _frame):
        for number in STOP_SIGNALS:  # the clean-up itself must not be interrupted
            signal.signal(number, signal.SIG_IGN)
        raise SystemExit(128 + signum)

    previous = [(number, signal.signal(number, stop)) for number in STOP_SIGNALS]
    try:
        yield
    finally:
        for number, handler in previous:
            signal.signal(number, handler)
