"""Command line of plot.py maps: the maps of several runs over one bag, side by side, and the same part of each enlarged."""

import argparse
import os

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from vi_ekf_slam.bag.limits import require_bounded_chunks
from vi_ekf_slam.bag.opening import open_bag
from vi_ekf_slam.bag.topics import TYPES
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output, replacing
from vi_ekf_slam.evaluation.run_io import read_run
from vi_ekf_slam.evaluation.top_view import plain, show_view, view_limits

COLORS = ("tab:blue", "tab:red")  # last seen in the first half of the drive, in the second
LEAST_FRAMES = 10  # landmarks that were seen less often blur any map
ZOOM_SIDE, ZOOM_SHARE = 60.0, 0.25  # m, and of the whole view's longer side: the smaller of both
ZOOM_PLACES = 200  # along the trajectory that are tried


class Map:
    """ids (L,) and positions (L, 3) m of the landmarks of a run, and its trajectory (N, 3) m at stamps (N,) s."""

    def __init__(self, folder):
        run = read_run(folder)
        path = os.path.join(folder, "landmarks.csv")
        self.ids = np.array([])
        if len(run.landmarks):  # of 64 bits
            self.ids = np.loadtxt(path, np.uint64, delimiter=",", skiprows=1, usecols=0, ndmin=1)
        self.positions = run.landmarks
        self.trajectory, self.stamps = run.poses[:, :3, 3], run.stamps

    def select(self, tracks, least):
        """Landmarks seen in `least` frames or more: (positions, whether they were last seen in the second half)."""
        chosen = np.array([tracks.get(id_, (0, 0.0))[0] >= least for id_ in self.ids], dtype=bool)
        late = np.array([tracks[id_][1] > 0.5 for id_ in self.ids[chosen]], dtype=bool)
        return self.positions[chosen], late


def read_tracks(path, topic):
    """({id: (frames in which it is seen, share of the drive, 0 to 1, after which it is not any more)}, stamps (N,) s) of a bag's
    features."""
    stamps, tracks = [], {}
    with open_bag(path) as bag:
        require_bounded_chunks(bag, path)
        kind = getattr(bag.get_type_and_topic_info().topics.get(topic), "msg_type", None)
        for _, message, _ in bag.read_messages([topic]) if kind in TYPES["features"] else ():
            stamps.append(message.header.stamp.to_sec())
            for feature in message.features:
                tracks[feature.id] = (tracks.get(feature.id, (0, 0.0))[0] + 1, stamps[-1])
    if not tracks:
        raise InputError("%s: has no features on %s; of pictures, run_bag --save-features OUT.bag makes a bag that has them"
                         % (path, topic))
    length = max(stamps[-1] - stamps[0], 1e-9)
    return {id_: (frames, (stamp - stamps[0]) / length) for id_, (frames, stamp) in tracks.items()}, np.array(stamps)


def common_place(trajectory, selected, side):
    """(x, y) m on the trajectory (N, 3) about which all maps show something in a square of `side` m.

    selected: Map.select of each. Of the places that are tried the one at which the poorest map has most landmarks of both
    halves of the drive, where there is such a place, else most at all.
    """
    places = trajectory[::max(1, len(trajectory) // ZOOM_PLACES), :2]

    def poorest(place):
        counts = []
        for positions, late in selected:
            inside = np.all(np.abs(positions[:, :2] - place) <= 0.5 * side, axis=1)
            counts.append((int(min(np.sum(inside & late), np.sum(inside & ~late))), int(np.sum(inside))))
        return min(counts)
    return max(places, key=poorest)


def draw(maps, names, selected, limits, zoom):
    """The picture as a Figure. maps: list of Map; selected: Map.select of each; limits, zoom: of all and of the part to enlarge."""
    figure = Figure(figsize=(6.0 * len(maps), 10.5), dpi=110)
    axes = figure.subplots(2, len(maps), squeeze=False, gridspec_kw={"hspace": 0.18})
    for column, (m, name, (positions, second)) in enumerate(zip(maps, names, selected)):
        for row, (view, size) in enumerate(((limits, 3), (zoom, 10))):
            plot = axes[row, column]
            for half, color in enumerate(COLORS):
                chosen = positions[second == bool(half)]
                plot.scatter(chosen[:, 0], chosen[:, 1], s=size, c=color, linewidths=0, alpha=0.7,
                             label="last seen in the %s half of the drive" % ("first", "second")[half])
            plot.plot(m.trajectory[:, 0], m.trajectory[:, 1], color="black", linewidth=0.8, label="trajectory")
            show_view(plot, view)
        axes[0, column].set_title(plain(name), fontsize=12)
        (x_low, x_high), (y_low, y_high) = zoom
        axes[0, column].add_patch(Rectangle((x_low, y_low), x_high - x_low, y_high - y_low, fill=False, linewidth=1.2))
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="lower center", ncol=3, frameon=False, markerscale=3)
    return figure


def zoom_limits(words, maps, selected, limits):
    """((x_low, x_high), (y_low, y_high)) of --zoom X Y SIDE, or of a part of `limits` in which all maps have landmarks."""
    if words is None:
        side = min(ZOOM_SIDE, ZOOM_SHARE * max(high - low for low, high in limits))
        x, y = common_place(maps[0].trajectory, selected, side)
    else:
        x, y, side = words
    if not np.isfinite([x, y, side]).all():
        raise InputError("--zoom is %g %g %g, allowed: finite numbers" % (x, y, side))
    if not side > 0.0:
        raise InputError("--zoom has the side %g m, allowed: more than 0" % side)
    return (x - 0.5 * side, x + 0.5 * side), (y - 0.5 * side, y + 0.5 * side)


def compare_maps(options):
    """Do what the parsed options ask; InputError when something is refused."""
    check_output(options.output, suffix=".png")
    names = options.names or [os.path.basename(os.path.abspath(run)) for run in options.runs]
    if len(names) != len(options.runs):
        raise InputError("--names has %d names for %d runs, allowed: one each" % (len(names), len(options.runs)))
    maps = [Map(run) for run in options.runs]
    tracks, stamps = read_tracks(options.bag, "/" + options.features.lstrip("/"))
    for run, m in zip(options.runs, maps):  # ids are as small elsewhere
        if m.stamps[0] > stamps[-1] or m.stamps[-1] < stamps[0]:
            raise InputError("%s: is of another time than the features of %s, allowed: runs over that bag" % (run, options.bag))
    selected = [m.select(tracks, options.least) for m in maps]
    limits = view_limits([m.trajectory for m in maps], landmarks=np.vstack([positions for positions, _ in selected]))
    zoom = zoom_limits(options.zoom, maps, selected, limits)
    for run, m, (positions, _) in zip(options.runs, maps, selected):
        if len(m.positions) and not len(positions):
            raise InputError("%s: of its %d landmarks none was seen in %d frames of %s, allowed: runs over that bag, and a smaller --least"
                             % (run, len(m.positions), options.least, options.bag))
    with replacing(options.output) as stream:
        draw(maps, names, selected, limits, zoom).savefig(stream, format="png", bbox_inches="tight")
    print("wrote: %s" % options.output)


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused."""
    parser = argparse.ArgumentParser(
        prog="plot.py maps",
        description="Draw the maps of runs over the same bag side by side, from above, and below a part of each enlarged. "
                    "Colours tell landmarks last seen in the first half of the drive from the others: where a road was "
                    "driven twice, walls are double in a map that does not fit together.")
    parser.add_argument("runs", metavar="RUN", nargs="+", help="directory of run_bag or the node")
    parser.add_argument("--bag", required=True, help="the bag of all runs, for when a landmark was seen")
    parser.add_argument("--features", metavar="TOPIC", default="/features", help="(default: %(default)s)")
    parser.add_argument("--names", metavar="NAME", nargs="+", help="titles (default: the directories' names)")
    parser.add_argument("--zoom", metavar=("X", "Y", "SIDE"), type=float, nargs=3,
                        help="centre and side of the enlarged part, m (default: 60 m, or a quarter of the view, where all maps have "
                             "landmarks, of both halves if possible)")
    parser.add_argument("--least", metavar="FRAMES", type=int, default=LEAST_FRAMES,
                        help="leave landmarks out that were seen in fewer frames (default: %(default)s)")
    parser.add_argument("--output", metavar="PNG", default="maps.png", help="picture to write (default: %(default)s)")
    return exit_status(compare_maps, parser.parse_intermixed_args(argv))
