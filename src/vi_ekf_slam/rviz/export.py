"""Command line of export_rviz_config.py."""

import argparse
import re

from vi_ekf_slam.common.checks import require_positive
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output, replacing
from vi_ekf_slam.rviz.config import (DISPLAYS, FRAMES, TRACKS, dump_config, load_config, set_frames, set_topic,
                                     shipped_path, set_scale, topic_displays)
from vi_ekf_slam.rviz.offer_checks import check

TOPIC_NAME = re.compile(r"^[A-Za-z/][A-Za-z0-9_/]*$")
SHIPPED_TRUTH = "/ground_truth/path"
HELP = {"path": "the estimated path", "dead_reckoning": "the path of dead reckoning",
        "truth": "the true path; its default is left out where there is none", "landmarks": "the map as markers",
        "landmark_cloud": "the map as points of a fixed size", "pose": "the pose with its covariance"}


def make_parser():
    parser = argparse.ArgumentParser(
        prog="export_rviz_config.py",
        description="Write an rviz configuration for your own frames and topics. No display and no rviz is needed. "
                    "With --bag or --check-graph it is checked first that the topics exist with the right types, and "
                    "the frames.")
    parser.add_argument("--output", metavar="FILE", required=True, help="configuration to write, FILE.rviz")
    frames = parser.add_argument_group("frames")
    for option, default in FRAMES.items():
        frames.add_argument("--" + option.replace("_", "-"), default=default, metavar="FRAME",
                            help="default: %(default)s" +
                            ("; '' where there is none (single_tf)" if option == "odom_frame" else ""))
    parser.add_argument("--scale", type=float, default=1.0, metavar="FACTOR", help="size of all that is drawn: 1 for a "
                        "car, 0.05 for what is carried by hand, as rviz/handheld.rviz (default: %(default)s)")
    topics = parser.add_argument_group("topics", "An empty name ('') leaves the display out.")
    shipped = {d.name: d for d in topic_displays(load_config(shipped_path()))}
    for option, name in DISPLAYS.items():
        topics.add_argument("--" + option.replace("_", "-"), default=shipped[name].topic, metavar="TOPIC",
                            help="%s, %s (default: %%(default)s)" % (HELP[option], shipped[name].kind))
    topics.add_argument("--namespace", default="/", metavar="NAME", help="of all topics but those given with a leading "
                        "slash and the default of --truth (default: %(default)s)")
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--bag", metavar="BAG", help="check against this bag")
    source.add_argument("--check-graph", action="store_true",
                        help="check against the running graph (ROS_MASTER_URI); waits up to 5 s for transforms")
    return parser


def resolve_topics(options):
    """{name of a display: absolute topic or ''}; InputError for a name that ROS does not allow."""
    if not options.namespace.startswith("/") or (options.namespace != "/" and not _is_name(options.namespace)):
        raise InputError("--namespace is '%s', allowed: an absolute name such as /robot1" % options.namespace)
    defaults = {option: make_parser().get_default(option) for option in DISPLAYS}
    topics = {}
    for option, name in DISPLAYS.items():
        topic = getattr(options, option)
        if topic and not _is_name(topic):
            raise InputError("--%s is '%s', allowed: letters, digits, _ and / (not twice in a row, not at the end), "
                             "beginning with a letter or /" % (option.replace("_", "-"), topic))
        relative = topic and (not topic.startswith("/") or (topic == defaults[option] and option != "truth"))
        topics[name] = options.namespace.rstrip("/") + "/" + topic.lstrip("/") if relative else topic
    return topics


def _is_name(name):
    return bool(TOPIC_NAME.match(name)) and "//" not in name and not name.endswith("/")


def check_frames(options):
    """{option: frame}; InputError for a name that TF does not allow, or for two frames of one name."""
    frames = {option: getattr(options, option) for option in FRAMES}
    for option, frame in frames.items():
        if option == "odom_frame" and not frame:
            continue
        if not frame or frame.startswith("/") or not frame.isprintable() or " " in frame:
            raise InputError("--%s is '%s', allowed: a name without spaces and without a leading slash"
                             % (option.replace("_", "-"), frame))
    if len(set(frames.values())) < len(frames):
        raise InputError("the frames are %s, allowed: three different names" % ", ".join(frames.values()))
    return frames


def export(options):
    """Do what the parsed options ask; InputError when something is refused."""
    check_output(options.output, options.bag)
    frames, topics = check_frames(options), resolve_topics(options)
    require_positive(options.scale, "--scale")
    config = load_config(shipped_path())
    if options.scale != 1.0:
        set_scale(config, options.scale)
    for name, topic in topics.items():
        set_topic(config, name, topic)
    set_topic(config, TRACKS, options.namespace.rstrip("/") + "/front_end/image")
    set_frames(config, {FRAMES[option]: frame for option, frame in frames.items()})
    displays = topic_displays(config)
    if options.bag or options.check_graph:
        from vi_ekf_slam.rviz import offers  # needs a ROS installation's Python halves; the rest needs none
        offer = offers.read_bag(options.bag, [d.topic for d in displays]) if options.bag \
            else offers.read_graph(frames.values())
        if options.truth == SHIPPED_TRUTH and options.truth not in offer.topics:
            print("%s has no truth: its display is left out" % offer.source)
            set_topic(config, DISPLAYS["truth"], "")
            displays = topic_displays(config)
        print(check(offer, displays, {option: frame for option, frame in frames.items() if frame}))
    with replacing(options.output) as stream:
        stream.write(dump_config(config))
    print("wrote: %s" % options.output)


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused."""
    return exit_status(export, make_parser().parse_args(argv))
