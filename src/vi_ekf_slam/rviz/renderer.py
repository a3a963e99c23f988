"""Command line of render_rviz.py."""

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time

from tqdm import tqdm

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output, replacing
from vi_ekf_slam.common.stop_signals import signals_unwind
from vi_ekf_slam.ros.private_ros import child, find_program, published_topics, ros_master, set_parameter, x_server
from vi_ekf_slam.rviz import offers
from vi_ekf_slam.rviz.config import (TRACKS, TRUTH, displays_of, dump_config, load_config, set_frame_rate, shipped_path,
                                     switch, topic_displays)
from vi_ekf_slam.rviz.legend import add_legend
from vi_ekf_slam.rviz.session import RvizCrash, RvizSession

EXIT_FAILED = 1
LIMITS = (200, 4096)  # px
MAX_ANIMATION_WIDTH = 640  # px
SMALL_LETTERS = 11  # px
OCTREE = 2  # Image.FASTOCTREE in old versions of Pillow, Image.Quantize.FASTOCTREE in new ones
ANIMATION_FRAMES, ANIMATION_STEP_MS = 60, 100
PLAYER_DELAY_S = 1.0  # between the advertising of topics and their first message, so that rviz is connected
SLACK_S = 60.0  # for the start of programs, beyond the time that playing takes
RATE, PICTURES_RATE = 4.0, 1.0  # speeds of the bag; the front end keeps up with real time
FRAME_RATE = 10  # Hz; without a graphics card a frame costs a core up to 30 ms, and nobody watches
SETTLE_S, SETTLE_LIMIT_S = 2.0, 6.0  # after the last message


class RvizError(Exception):
    """rviz could not show what it was to show; the message says what it reports."""


def make_parser():
    parser = argparse.ArgumentParser(
        prog="render_rviz.py",
        description="Play a bag into rviz on a virtual screen and save what it shows at the end. A bag with the "
                    "outputs of slam_node (slam.launch record:=true) is played as it is, a drive through slam.launch. "
                    "Ends with 1 when rviz reports an error, or when a display's status is an error or a warning.")
    parser.add_argument("bag", metavar="BAG")
    parser.add_argument("output", metavar="OUT.png")
    parser.add_argument("--config", metavar="FILE.rviz", help="default: the shipped one; where the bag has no truth, "
                        "its display '%s' is switched off, and '%s' on where it has the front end's picture" % (TRUTH, TRACKS))
    parser.add_argument("--view", choices=("config", "top"), default="config",
                        help="config: the view of the configuration; top: from straight above, all paths in view "
                             "(default: %(default)s)")
    parser.add_argument("--size", nargs=2, type=int, default=(1280, 800), metavar=("WIDTH", "HEIGHT"),
                        help="of rviz's view in pixels (default: 1280 800)")
    parser.add_argument("--animation", "--gif", metavar="OUT.gif",
                        help="save an animated picture of the whole bag as well, at most %d px wide" % MAX_ANIMATION_WIDTH)
    parser.add_argument("--no-legend", action="store_true", help="rviz's view alone, without the legend below it")
    parser.add_argument("--rate", type=float, metavar="N", help="speed of the bag; 1 is real time (default: %g, of a "
                        "drive of pictures %g)" % (RATE, PICTURES_RATE))
    parser.add_argument("--params", metavar="FILE.yaml", help="configuration of slam_node for a drive (default: "
                        "slam.launch's)")
    parser.add_argument("--quiet", action="store_true", help="no report and no progress bar")
    return parser


def check_options(options):
    """InputError for what cannot be done, before anything is started."""
    if options.rate is not None:
        checks.require_positive(options.rate, "--rate")
    for value, name in zip(options.size, ("WIDTH", "HEIGHT")):
        if not LIMITS[0] <= value <= LIMITS[1]:
            raise InputError("--size: %s is %d px, allowed: %d to %d" % ((name, value) + LIMITS))
    for path, suffix, name in ((options.output, ".png", "OUT.png"), (options.animation, ".gif", "--animation")):
        if path is not None:
            check_output(path, options.bag, suffix, name)
    if options.params and not os.path.isfile(options.params):
        raise InputError("%s: no such file" % options.params)


def player_command(options, offer, displays, folder):
    """The command that plays the bag; it ends by itself, when all is played, only for a drive."""
    bag = os.path.abspath(options.bag)
    if offer.is_drive(displays):
        command = [find_program("roslaunch", "python3-roslaunch"), "vi_ekf_slam", "slam.launch", "bag:=" + bag,
                   "rate:=%g" % options.rate, "output_dir:=" + os.path.join(folder, "run")]
        command += offer.front_end()
        return command + (["config:=" + os.path.abspath(options.params)] if options.params else [])
    shown = sorted({d.topic for d in displays if d.topic in offer.topics} | set(offers.TF_TOPICS))
    return [find_program("rosbag", "python3-rosbag"), "play", "--clock", "--keep-alive", "--quiet",
            "--delay=%g" % PLAYER_DELAY_S, "--rate=%g" % options.rate, bag, "--topics"] + shown


def prepare_config(options, folder):
    """(path of the configuration to show, its displays, the bag's Offer)."""
    config = load_config(options.config or shipped_path())
    if not options.config:
        switch(config, TRACKS, True)
    displays = topic_displays(config)
    offer = offers.read_bag(options.bag, [d.topic for d in displays])
    for display in displays:
        if display.name in (TRACKS, TRUTH) and display.topic not in offer.topics:
            switch(config, display.name, False)
    displays = topic_displays(config)
    set_frame_rate(config, FRAME_RATE)
    path = os.path.join(folder, "shown.rviz")
    with open(path, "wb") as stream:
        stream.write(dump_config(config))
    return path, displays, offer


class Playback:
    """Follows a bag while it is played into a session, and takes the pictures."""

    def __init__(self, options, session, player, offer, folder):
        self.options, self.session, self.player, self.offer, self.folder = options, session, player, offer, folder
        self.pictures = []
        self.cell = None  # m, of the grid, where it is not the configuration's
        self.published = {}  # topic: type, of all that was ever published
        self.limit_s = (offer.end - offer.start) / options.rate + SLACK_S
        self.end = time.monotonic() + self.limit_s

    def run(self, log, bar):
        """Until the bag is over; pictures for the animation meanwhile."""
        while True:
            code, now = self.player.poll(), self.session.ask("time")["time"]
            if code is not None and code != 0:
                raise RvizError("the player ended with code %d: %s" % (code, _last_lines(log)))
            if code == 0 or now > self.offer.end:
                return
            if time.monotonic() > self.end:
                raise RvizError("the bag is not over after %.0f s: %s" % (self.limit_s, _last_lines(log)))
            self.published.update(published_topics(self.session.environment))
            share = (now - self.offer.start) / max(self.offer.end - self.offer.start, 1e-9)
            bar.update(max(0, int(100 * share) - bar.n))
            if self.options.animation and share * ANIMATION_FRAMES >= len(self.pictures) and share >= 0.0:
                self.take()
            time.sleep(0.05)

    def take(self):
        """One picture more. Returns its path."""
        path = os.path.join(self.folder, "%04d.png" % len(self.pictures))
        if self.options.view == "top":
            self.cell = self.session.ask("fit")["cell"]
            self.session.draw(2)
        self.session.ask("grab", path=path)
        self.pictures.append(path)
        return path

    def settle(self):
        """Wait until what was sent last is drawn. Returns the displays' statuses, good or bad."""
        end = time.monotonic() + SETTLE_LIMIT_S
        time.sleep(SETTLE_S)
        self.session.draw(3)
        displays = self.session.ask("status")["displays"]
        while any(d["level"] != "Ok" for d in displays) and time.monotonic() < end:
            time.sleep(0.2)
            displays = self.session.ask("status")["displays"]
        return displays


def complaints(displays, errors, wanted, published):
    """One line for each status that is not Ok, for each error that rviz printed, and for each display without a source.

    A display that waits for a topic that nobody publishes, or publishes with another type, has the status Ok in rviz.
    wanted: [TopicDisplay]; published: {topic: type}.
    """
    lines = ["display '%s' (%s) has the status %s: %s" % (d["display"], d["class"], d["level"],
                                                        "; ".join(d["messages"]) or "no text")
             for d in displays if d["level"] != "Ok"]
    for display in wanted:
        kind = published.get(display.topic)
        if kind != display.kind:
            found = "is published as %s" % kind if kind else \
                "is not published; there are: %s" % (", ".join(sorted(published)) or "none")
            lines.append("display '%s': its topic %s %s; it needs %s"
                         % (display.name, display.topic, found, display.kind))
    return lines + ["rviz printed: %s" % line for line in errors]


def render(options):
    """Do what the parsed options ask. InputError when something is refused, RvizError when rviz is not content."""
    check_options(options)
    try:
        _render(options)
    except RvizCrash as reason:  # a fault of rviz 1.14's own memory, seen once in some hundred pictures
        print("%s; it is started once more" % reason, file=sys.stderr)
        _render(options)


def _render(options):
    width, height = options.size
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="render_rviz_"))
        config, displays, offer = prepare_config(options, folder)
        if options.rate is None:
            options.rate = PICTURES_RATE if offer.is_drive(displays) and offer.front_end() else RATE
        command = player_command(options, offer, displays, folder)
        environment = stack.enter_context(ros_master(folder))
        set_parameter(environment, "/use_sim_time", True)
        screen = stack.enter_context(x_server(width + 200, height + 200))
        session = stack.enter_context(RvizSession(config, options.size, dict(environment, DISPLAY=screen), folder))
        log = stack.enter_context(open(os.path.join(folder, "player.log"), "w+b"))
        player = stack.enter_context(child(command, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log))
        playback = Playback(options, session, player, offer, folder)
        hide = options.quiet or not sys.stderr.isatty()
        with tqdm(total=100, desc="playing", unit="%", disable=hide) as bar:
            playback.run(log, bar)
        statuses = playback.settle()
        last = playback.take()
        bad = complaints(statuses, session.errors(), displays, playback.published)
        if bad:
            raise RvizError("%s\n%s" % (options.bag, "\n".join("  " + line for line in bad)))
        _write(options, None if options.no_legend else _as_drawn(config, playback.cell), playback.pictures, last)
    if not options.quiet:
        print("\n".join(["%s: %s" % (d["display"], "; ".join(d["messages"]) or d["level"]) for d in statuses] +
                        ["wrote: %s" % path for path in (options.output, options.animation) if path]))


def _as_drawn(path, cell):
    config = load_config(path)
    for display in displays_of(config):
        if cell and display["Class"] == "rviz/Grid":
            display["Cell Size"] = cell
    return config


def _write(options, config, pictures, last):
    """config: whose legend is drawn, or None."""
    from PIL import Image
    with Image.open(last) as picture, replacing(options.output) as stream:
        picture = picture.convert("RGB")
        (picture if config is None else add_legend(picture, config)).save(stream, format="PNG")
    if options.animation:
        with replacing(options.animation) as stream:
            _animate(pictures, config, stream)


def _animate(paths, config, stream):
    from PIL import Image
    frames = []
    for path in paths:
        with Image.open(path) as picture:
            scale = min(1.0, MAX_ANIMATION_WIDTH / picture.width)
            small = picture.convert("RGB").resize((round(scale * picture.width), round(scale * picture.height)))
            if config is not None:
                small = add_legend(small, config, SMALL_LETTERS)
            # The octree keeps thin lines' colours, which cover too little for the other methods' palettes.
            frames.append(small.quantize(256, method=OCTREE))
    durations = [ANIMATION_STEP_MS] * (len(frames) - 1) + [20 * ANIMATION_STEP_MS]
    frames[0].save(stream, format="GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0)


def _last_lines(log):
    log.flush()
    log.seek(0)
    lines = log.read().decode("utf-8", "replace").splitlines()
    return " | ".join(line.strip() for line in lines[-5:]) or "it printed nothing"


def main(argv=None):
    """Entry point: 0 on success; 2 when something is refused, 1 when rviz is not content, each with what is wrong."""
    options = make_parser().parse_args(argv)
    try:
        with signals_unwind():
            return exit_status(render, options)
    except RvizError as reason:
        print("error: %s" % reason, file=sys.stderr)
        return EXIT_FAILED
