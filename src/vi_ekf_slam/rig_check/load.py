"""Whether this machine keeps up: the CPU time of the package's own run_bag on the recording's first seconds."""

import os
import resource
import subprocess
import tempfile

from vi_ekf_slam.bag.opening import open_bag
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.package_files import package_program
from vi_ekf_slam.common.yaml_file import read_yaml

SPAN = 5.0  # s of the recording
YELLOW, RED = 0.5, 0.9  # of one core: beside it a robot has other work, and the front end runs in a node of its own
LIMIT = 120.0  # s of wall time


def check_load(rig, report):
    """CPU time over sensor time."""
    if rig.motion is None:
        report.unjudged("the camera's motion is not known")
        return
    try:
        program = package_program("run_bag")
    except InputError as reason:
        report.unjudged(str(reason))
        return
    with tempfile.TemporaryDirectory() as folder:
        part = os.path.join(folder, "part.bag")
        span = _copy(rig, part)
        command = [program, part, "--output", os.path.join(folder, "run"), "--quiet"]
        for name, topic in sorted(rig.topics.items()):
            command += ["--" + name.replace("_", "-"), topic[:-len("/compressed")] if topic.endswith("/compressed") else topic]
        before = _children_s()
        try:
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, timeout=LIMIT)
        except subprocess.TimeoutExpired:
            report.red("this machine does not keep up", "more than %g s for %g s of sensor time" % (LIMIT, SPAN), "%g" % RED,
                       "fewer tracks (front_end/features, invariant/max_tracked), a lower rate")
            return
        spent = _children_s() - before  # not the wall time, in which others may have the cores
        summary = os.path.join(folder, "run", "summary.yaml")
        if done.returncode != 0 or not os.path.isfile(summary):
            lines = done.stdout.strip().splitlines()
            report.unjudged("run_bag ends with status %d: %s" % (done.returncode, lines[-1] if lines else ""))
            return
        numbers = read_yaml(summary)
    if not float(numbers.get("sensor_s", 0.0)) > 0.0:
        report.unjudged("run_bag has processed nothing of it")
        return
    rate = len(rig.motion.begin) and 1e9 / float(min(rig.motion.end - rig.motion.begin))
    tracks = float(sorted(rig.motion.tracks)[len(rig.motion.tracks) // 2])
    load = spent / span
    figure = "%.0f %% of a core for %.0f tracks at %.3g Hz (%.2f s of CPU for %.1f s)" % (100.0 * load, tracks, rate, spent, span)
    limit = "%.0f %%" % (100.0 * YELLOW)
    if load > YELLOW:
        report.complain(load > RED, "the load on this machine is high", figure, limit,
                        "fewer tracks (front_end/features, invariant/max_tracked), a lower rate of frames")
    else:
        report.green("the load on this machine", figure, limit)


def _copy(rig, path):
    """The recording's first SPAN s of what run_bag reads; returns how many s there are."""
    import rosbag
    wanted = list(rig.topics.values()) + ["/tf_static", "/tf"]
    with open_bag(rig.path) as bag, rosbag.Bag(path, "w") as part:
        begin = end = None
        for topic, raw, received, connection in bag.read_messages(wanted, raw=True, return_connection_header=True):
            begin = begin if begin is not None else received.to_sec()
            if received.to_sec() > begin + SPAN:
                break
            end = received.to_sec()
            part.write(topic, raw, received, raw=True, connection_header=connection)
    return max(end - begin, 0.1)


def _children_s():
    """CPU time of ended child processes, s."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
