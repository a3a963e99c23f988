"""How every program of this package ends when it refuses something."""

import os
import sys

from vi_ekf_slam.common.errors import InputError

EXIT_REFUSED = 2
EXIT_NOT_READ = 141  # as of a program that SIGPIPE ends


def exit_status(action, *arguments, source=None):
    """Call action(*arguments): 0, or EXIT_REFUSED after one line on stderr when it raises InputError or lacks a module;
    EXIT_NOT_READ where nobody reads standard output any more, such as head.

    source: the input to name where memory does not suffice for it; None: MemoryError passes through.
    """
    if getattr(sys.stdout, "errors", "") == "strict" and hasattr(sys.stdout, "reconfigure"):  # a name may hold what its encoding lacks
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        action(*arguments)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the interpreter flushes it once more
        return EXIT_NOT_READ
    except InputError as reason:
        return _refuse(reason)
    except ModuleNotFoundError as reason:  # a headless robot has none of those that draw
        return _refuse("the Python module %s is not installed, which this needs (Debian and Ubuntu: python3-%s)"
                       % (reason.name, reason.name.split(".")[0]))
    except MemoryError:
        if source is None:
            raise
        return _refuse("%s: not enough memory" % source)
    return 0


def _refuse(reason):
    print("error: %s" % reason, file=sys.stderr)
    return EXIT_REFUSED
