"""Draw runs from above: trajectories, truth and the landmark map with its covariances."""

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

MARGIN = 0.12  # of the trajectories' larger extent, around them
MIN_MARGIN = 0.1  # m
ROOM = 2.0  # of that extent: so far around them the view is widened for landmarks, and they keep a fifth of it
MOST = (3.0, 97.0)  # percentiles of the landmarks along each axis, between which the view holds them
MIN_ASPECT = 0.45  # of height to width or width to height, for straight drives
LONG_SIDE = 9.0  # inch
CELLS = 26  # along the longer side of the view; a cell holds at most one ellipse
ENLARGEMENTS = (1, 2, 5, 10, 20, 50, 100)
SIGMAS_95 = 2.4477  # a plane normal distribution lies within so many standard deviations with 95 %
DASHES = (0, (4, 4))  # of a line over one that it nearly agrees with, so that both are seen
TRUTH_STYLE = {"color": "black", "linewidth": 2.6, "zorder": 3}
DEAD_RECKONING_STYLE = {"color": "tab:gray", "linewidth": 1.4, "linestyle": "--", "zorder": 4}
DEAD_RECKONING_ON_TOP = dict(DEAD_RECKONING_STYLE, zorder=5.5)  # beside runs that may be equal to it
SLAM_STYLE = {"color": "tab:red", "linewidth": 1.4, "zorder": 5}
SMOOTHED_STYLE = {"color": "tab:blue", "linewidth": 1.4, "linestyle": DASHES, "zorder": 6}


def view_limits(trajectories, min_aspect=MIN_ASPECT, landmarks=()):
    """((x_min, x_max), (y_min, y_max)) in m: the whole of every trajectory and a margin, and most of the landmarks about it.

    The walls of a room are farther apart than the path of what is carried in it; a landmark a kilometre away does not shrink
    the picture. landmarks: (L, 2 or more) m. min_aspect: of the shorter side to the longer one.
    """
    points = np.vstack([t[:, :2] for t in trajectories])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)  # nan: where a truth has a gap
    extent = float((high - low).max())
    if len(landmarks):
        near = landmarks[~np.any((landmarks[:, :2] < low - ROOM * extent) | (landmarks[:, :2] > high + ROOM * extent), axis=1), :2]
    margin = max(MIN_MARGIN, MARGIN * extent)
    low, high = low - margin, high + margin
    if len(landmarks) and len(near):
        first, last = np.percentile(near, MOST, axis=0)
        low, high = np.minimum(low, first), np.maximum(high, last)
    half = 0.5 * (high - low)
    half = np.maximum(half, min_aspect * half.max())
    centre = 0.5 * (low + high)
    return tuple((float(c - h), float(c + h)) for c, h in zip(centre, half))


def inside(points, limits):
    """(N,): which of the points (N, 2 or more) are within ((x_min, x_max), (y_min, y_max))."""
    low, high = np.transpose(limits)
    return np.all((points[:, :2] >= low) & (points[:, :2] <= high), axis=1)


def plain(name):
    """A name as text of a picture, which takes what is between dollars for mathematics, and leaves `_a` out of its legend; bytes
    of a path that are no UTF-8 are question marks."""
    return (" " if name.startswith("_") else "") + name.encode(errors="replace").decode().replace("$", r"\$")


def draw_run(title, slam, dead_reckoning, truth, landmarks, deviations, covariances=None, smoothed=None):
    """The picture of a run as a matplotlib Figure.

    slam: (N, 3) positions in m; dead_reckoning, truth, smoothed: the same or None. landmarks: (L, 3) m, deviations: (L,)
    horizontal standard deviations in m, one colour each. covariances: (L, 3, 3) m^2 for ellipses, or None.
    """
    lines = [("truth", truth, TRUTH_STYLE), ("dead reckoning", dead_reckoning, DEAD_RECKONING_STYLE),
             ("SLAM", slam, SLAM_STYLE), ("smoothed", smoothed, SMOOTHED_STYLE)]
    return draw_trajectories(title, [line for line in lines if line[1] is not None], landmarks, deviations, covariances)


def draw_trajectories(title, lines, landmarks=(), deviations=(), covariances=None, limits=None, long_side=LONG_SIDE,
                      colors=None):
    """Trajectories over landmarks as a Figure. lines: (label, (N, 3) positions in m, style); the last has the start.

    limits: of view_limits, and colors: of color_limits, for pictures to be compared; None: what suits this one.
    long_side: inch, the smaller the larger is the text beside it.
    """
    limits = limits or view_limits([positions for _, positions, _ in lines], landmarks=landmarks)
    width, height = (high - low for low, high in limits)
    scale = long_side / max(width, height)
    figure = Figure(figsize=(scale * width + 2.5, scale * height + 1.8), dpi=130)
    axes = figure.add_subplot()
    if len(landmarks):
        _draw_landmarks(figure, axes, landmarks, deviations, covariances, limits, colors)
    _draw_lines(axes, lines, limits)
    axes.set_title(title, fontsize=11)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.6 / (scale * height)), ncol=5, fontsize=9, frameon=False)
    return figure


def draw_alignments(title, panels):
    """Trajectories side by side, one panel for each way to lay them onto the truth. Returns a Figure.

    panels: (title, [(label, (N, 3) positions in m, style)]); the last line of each has the start.
    """
    # Frames may be turned against each other: views of one size, each about the middle of its own lines.
    limits = [view_limits([positions for _, positions, _ in lines]) for _, lines in panels]
    half = [0.5 * max(view[k][1] - view[k][0] for view in limits) for k in (0, 1)]
    limits = [tuple((0.5 * (low + high) - h, 0.5 * (low + high) + h) for (low, high), h in zip(view, half))
              for view in limits]
    scale = 0.7 * LONG_SIDE / max(2.0 * h for h in half)
    width, height = (2.0 * scale * h for h in half)
    figure = Figure(figsize=(len(panels) * (width + 0.9), height + 1.9), dpi=130)
    grid = figure.subplots(1, len(panels), squeeze=False)[0]
    figure.subplots_adjust(left=0.05, right=0.99, top=1.0 - 1.0 / (height + 1.9), bottom=0.9 / (height + 1.9))
    for axes, (name, lines), view in zip(grid, panels, limits):
        _draw_lines(axes, lines, view)
        axes.set_title(name, fontsize=11)
    figure.suptitle(title, fontsize=12, y=1.0)
    figure.legend(*grid[0].get_legend_handles_labels(), loc="lower center", ncol=5, fontsize=10, frameon=False)
    return figure


def spread_out(points, deviations, limits, cell):
    """Indices of one point for each occupied square of side `cell` (m) in the view: that of the median deviation."""
    within, low, squares = np.flatnonzero(inside(points, limits)), np.transpose(limits)[0], {}
    for k in within[np.argsort(deviations[within], kind="stable")]:
        squares.setdefault(tuple(np.floor((points[k, :2] - low) / cell).astype(int)), []).append(k)
    return np.array(sorted(members[(len(members) - 1) // 2] for members in squares.values()), dtype=int)


def enlargement(deviations, cell):
    """By how much ellipses must be enlarged to be seen: most of them then keep within a square of side `cell` (m)."""
    room = 0.5 * cell / (SIGMAS_95 * float(np.percentile(deviations, 80.0)))
    return max([factor for factor in ENLARGEMENTS if factor <= room], default=1)


def tight_box(figure):
    """The part of the figure (matplotlib's Bbox, inches) that keeps every label inside; whoever saves it twice works it out once."""
    return figure.get_tightbbox(FigureCanvasAgg(figure).get_renderer()).padded(matplotlib.rcParams["savefig.pad_inches"])


def save(figure, stream, kind, dpi="figure", box="tight"):
    """Write the figure as `kind` ("png" or "svg"); the tight box keeps every label inside the picture."""
    # No date and no random ids: the same run gives the same file.
    with matplotlib.rc_context({"svg.hashsalt": "vi_ekf_slam"}):
        figure.savefig(stream, format=kind, dpi=dpi, bbox_inches=box, metadata={"Date": None} if kind == "svg" else None)


def color_limits(deviations):
    """Standard deviations (low, high) in m at the ends of the colours, or None where there are none to show."""
    usable = deviations[np.isfinite(deviations) & (deviations > 0.0)]
    if not len(usable):
        return None
    low, high = np.percentile(usable, [2.0, 98.0])
    return float(low), float(max(high, 1.01 * low))


def _draw_lines(axes, lines, limits):
    for label, positions, style in lines:
        axes.plot(positions[:, 0], positions[:, 1], label=label, **style)
    start = lines[-1][1][0]
    axes.plot(start[0], start[1], color="tab:red", marker="o", markersize=6, markeredgecolor="white",
              linestyle="none", label="start", zorder=6)
    show_view(axes, limits)


def show_view(axes, limits):
    """Axes of a picture from above that shows ((x_min, x_max), (y_min, y_max)) m."""
    axes.set_aspect("equal")
    axes.set_xlim(*limits[0])
    axes.set_ylim(*limits[1])
    axes.set_xlabel("x, seen from above (m)")
    axes.set_ylabel("y, seen from above (m)")
    axes.grid(True, linewidth=0.4, alpha=0.5)
    axes.set_axisbelow(True)


def _draw_landmarks(figure, axes, landmarks, deviations, covariances, limits, colors):
    usable = np.isfinite(deviations) & (deviations > 0.0)
    outside = int(np.sum(~inside(landmarks, limits)))
    if usable.any():
        norm = LogNorm(*(colors or color_limits(deviations)))
        points = axes.scatter(landmarks[usable, 0], landmarks[usable, 1], c=deviations[usable], s=5, linewidths=0,
                              cmap="viridis_r", norm=norm, zorder=2, rasterized=True)
        bar = figure.colorbar(points, ax=axes, shrink=0.8, pad=0.02, extend="both")
        bar.set_label("landmarks: horizontal standard deviation (m)")
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        bar.ax.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
    note = "%d landmarks" % len(landmarks)
    if outside:
        note += ", %d of them outside this view" % outside
    if covariances is not None and usable.any():
        note += "\n" + _draw_ellipses(axes, landmarks[usable], deviations[usable], covariances[usable], limits, norm)
    if not usable.all():
        note += ", %d without a valid variance not drawn" % int(np.sum(~usable))
    axes.annotate(note, (0.0, 0.0), xycoords="axes fraction", xytext=(6, 6), textcoords="offset points",
                  fontsize=8, zorder=7,
                  bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "none", "alpha": 0.8})


def _draw_ellipses(axes, landmarks, deviations, covariances, limits, norm):
    """95 % ellipses of landmarks far enough apart to be told from each other; returns the sentence that says so."""
    cell = max(high - low for low, high in limits) / CELLS
    chosen = spread_out(landmarks, deviations, limits, cell)
    factor = enlargement(deviations[chosen], cell) if len(chosen) else 1
    small = chosen[SIGMAS_95 * factor * deviations[chosen] <= cell]  # a larger one would cover its neighbours
    if len(chosen) and not len(small):
        return "95 %% ellipses reach farther than %.3g m and are not drawn" % cell
    chosen = small
    variances, directions = np.linalg.eigh(covariances[chosen][:, :2, :2])
    roots = directions * np.sqrt(np.maximum(variances, 0.0))[:, None, :]  # root root^T is the covariance
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = SIGMAS_95 * factor * np.array([np.cos(turn), np.sin(turn)])
    outlines = landmarks[chosen, None, :2] + np.swapaxes(roots @ circle, 1, 2)
    ellipses = LineCollection(outlines, cmap="viridis_r", norm=norm, linewidths=0.9, zorder=2.5)
    ellipses.set_array(deviations[chosen])
    axes.add_collection(ellipses)
    return "ellipses: 95 %% of %d landmarks, spread over the view%s" % (
        len(chosen), ", enlarged %d times" % factor if factor > 1 else "")
