"""The other end of viewer.py: starts rviz as a process and asks it."""

import contextlib
import importlib.util
import json
import os
import re
import select
import subprocess
import sys
import time

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.ros.private_ros import child

START_LIMIT_S, ANSWER_LIMIT_S = 120.0, 60.0
ERROR_LINE = re.compile(r"^\W*(?:\x1b\[[0-9;]*m)?\[(?:ERROR|FATAL)\]\s*(.*?)(?:\x1b\[[0-9;]*m)?$")


class RvizCrash(InputError):
    """rviz was ended by a signal, which no input of it explains."""


class RvizSession:
    """rviz as a context manager. environment: of a master and an X server; folder: for its log and its home."""

    def __init__(self, config, size, environment, folder):
        if getattr(importlib.util.find_spec("rviz"), "origin", None) is None:
            raise InputError("rviz's Python module is not installed (Debian: python3-rviz, Noetic: ros-noetic-rviz; "
                             "./scripts/setup.sh installs it)")
        self.folder = folder
        self.log_path = os.path.join(folder, "rviz.log")
        home, runtime = os.path.join(folder, "home"), os.path.join(folder, "runtime")
        os.mkdir(home)  # rviz keeps its settings there; the user's are not ours to read or to change
        os.mkdir(runtime, 0o700)
        self.command = [sys.executable, "-m", "vi_ekf_slam.rviz.viewer", config] + [str(length) for length in size]
        self.environment = dict(environment, HOME=home, XDG_RUNTIME_DIR=runtime, LIBGL_ALWAYS_SOFTWARE="1",
                                QT_X11_NO_MITSHM="1", ROSCONSOLE_FORMAT="[${severity}] ${message}")
        self.child = self.process = self.log = None

    def __enter__(self):
        self.log = open(self.log_path, "wb")
        # Not in the caller's folder, from which Python would take modules.
        self.child = child(self.command, env=self.environment, cwd=self.folder, stdin=subprocess.PIPE,
                           stdout=subprocess.PIPE, stderr=self.log)
        self.process = self.child.__enter__()
        try:
            self._read(START_LIMIT_S)
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(self, *_):
        self.process.stdin.close()  # tells it to end
        self.child.__exit__(None, None, None)
        self.process.stdout.close()
        self.log.close()

    def ask(self, action, **arguments):
        """The answer (dict) to a request of viewer.py."""
        try:
            self.process.stdin.write((json.dumps(dict(arguments, do=action)) + "\n").encode("utf-8"))
            self.process.stdin.flush()
        except BrokenPipeError:
            raise self._death()
        return self._read(ANSWER_LIMIT_S)

    def draw(self, count):
        """Wait until rviz has drawn `count` times more."""
        first = self.ask("time")["frames"]
        while self.ask("time")["frames"] < first + count:
            time.sleep(0.05)

    def errors(self):
        """What rviz printed as an error, each text once."""
        with open(self.log_path, encoding="utf-8", errors="replace") as stream:
            matches = [ERROR_LINE.match(line.rstrip()) for line in stream]
        return list(dict.fromkeys(match.group(1) for match in matches if match))

    def _read(self, limit):
        ready, _, _ = select.select([self.process.stdout], [], [], limit)
        line = self.process.stdout.readline() if ready else None
        if line is None:
            raise InputError("rviz does not answer within %.0f s" % limit)
        if not line:
            raise self._death()
        answer = json.loads(line.decode("utf-8"))
        if "error" in answer:
            raise InputError("rviz: %s" % answer["error"])
        return answer

    def _death(self):
        with open(self.log_path, encoding="utf-8", errors="replace") as stream:
            lines = stream.read().splitlines()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(ANSWER_LIMIT_S)
        crashed = (self.process.returncode or 0) < 0
        how = "was ended by signal %d" % -self.process.returncode if crashed else "ended by itself"
        said = " | ".join(lines[-5:]) or "it printed nothing"
        return (RvizCrash if crashed else InputError)("rviz %s: %s" % (how, said))
