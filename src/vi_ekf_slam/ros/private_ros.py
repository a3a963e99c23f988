"""A ROS master and an X server of one's own, for as long as a block lasts; nobody else's are disturbed."""

import contextlib
import os
import select
import shutil
import signal
import socket
import subprocess
import time
import xmlrpc.client

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.stop_signals import signals_wait

START_LIMIT_S = 60.0
STOP_LIMIT_S = 20.0
# What a caller's desktop or session may hold that would change what is seen or who is talked to.
FOREIGN = ("ROS_IP", "ROS_NAMESPACE", "ROSCONSOLE_CONFIG_FILE", "WAYLAND_DISPLAY", "XAUTHORITY", "QT_QPA_PLATFORM",
           "QT_SCALE_FACTOR", "QT_SCREEN_SCALE_FACTORS", "QT_AUTO_SCREEN_SCALE_FACTOR", "QT_STYLE_OVERRIDE")


def find_program(name, package):
    """Path of a program on the PATH; InputError with the Debian package that brings it."""
    found = shutil.which(name)
    if found is None:
        raise InputError("%s is not installed (Debian: %s; ./scripts/setup.sh installs it)" % (name, package))
    return found


def clean_environment(**changes):
    """A copy of this process's environment without FOREIGN, and with the changes."""
    kept = {name: value for name, value in os.environ.items() if name not in FOREIGN}
    return dict(kept, **changes)


@contextlib.contextmanager
def child(command, **options):
    """The process while the block lasts; at its end it and all that it started are ended."""
    process = None
    try:
        with signals_wait():
            process = subprocess.Popen(command, start_new_session=True, **options)
        yield process
    finally:
        if process is not None:
            _stop(process)


def _stop(process):
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        if process.poll() is not None:
            break
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(STOP_LIMIT_S)
    with contextlib.suppress(ProcessLookupError):  # a child of it that did not follow
        os.killpg(process.pid, signal.SIGKILL)


@contextlib.contextmanager
def x_server(width, height):
    """DISPLAY of a virtual screen, in pixels. The server itself picks a number that is free."""
    reading, writing = os.pipe()
    command = [find_program("Xvfb", "xvfb"), "-displayfd", str(writing), "-screen", "0",
               "%dx%dx24" % (width, height), "-nolisten", "tcp", "-noreset"]
    try:
        with child(command, pass_fds=[writing], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL):
            os.close(writing)
            writing = None
            ready, _, _ = select.select([reading], [], [], START_LIMIT_S)
            number = os.read(reading, 16).strip() if ready else b""
            if not number:
                raise InputError("Xvfb does not start with a screen of %d x %d" % (width, height))
            yield ":" + number.decode("ascii")
    finally:
        for end in (reading, writing):
            if end is not None:
                os.close(end)


def free_port():
    """A TCP port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def ros_master(folder):
    """Environment in which a master of its own runs; its files go into `folder`."""
    port = free_port()
    environment = clean_environment(ROS_MASTER_URI="http://localhost:%d" % port, ROS_HOSTNAME="localhost",
                                    ROS_HOME=folder, ROS_LOG_DIR=os.path.join(folder, "log"))
    command = [find_program("roscore", "python3-roslaunch"), "-p", str(port)]
    with child(command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
               stderr=subprocess.DEVNULL) as core:
        end = time.monotonic() + START_LIMIT_S
        while not _answers(environment["ROS_MASTER_URI"]):
            if core.poll() is not None or time.monotonic() > end:
                raise InputError("roscore does not start on port %d" % port)
            time.sleep(0.1)
        yield environment


def _answers(uri):
    try:
        return xmlrpc.client.ServerProxy(uri).getPid("/private_ros")[0] == 1
    except (OSError, xmlrpc.client.Error):
        return False


def published_topics(environment):
    """{topic: type} of what is published right now on that environment's master."""
    return dict(xmlrpc.client.ServerProxy(environment["ROS_MASTER_URI"]).getPublishedTopics("/private_ros", "")[2])


def set_parameter(environment, name, value):
    """Set a parameter on that environment's master."""
    xmlrpc.client.ServerProxy(environment["ROS_MASTER_URI"]).setParam("/private_ros", name, value)
