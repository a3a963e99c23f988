"""Draw a run from above: trajectories, truth and the landmark map."""

import matplotlib

matplotlib.use("Agg")  # files only; a machine without a display must do

import numpy as np  # noqa: E402
from matplotlib.colors import LogNorm  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter  # noqa: E402

MARGIN = 0.12  # of the trajectories' larger extent, around them
MIN_MARGIN = 10.0  # m
MIN_ASPECT = 0.45  # of height to width or width to height, for straight drives
LONG_SIDE = 9.0  # inch


def view_limits(trajectories):
    """((x_min, x_max), (y_min, y_max)) in m: the whole of every trajectory and a margin.

    Trajectories alone decide, so that a landmark a kilometre away does not shrink the picture.
    """
    points = np.vstack([t[:, :2] for t in trajectories])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = max(MIN_MARGIN, MARGIN * float((high - low).max()))
    half = 0.5 * (high - low) + margin
    half = np.maximum(half, MIN_ASPECT * half.max())
    centre = 0.5 * (low + high)
    return tuple((float(c - h), float(c + h)) for c, h in zip(centre, half))


def count_outside(points, limits):
    """Number of points (N, 2 or more) outside ((x_min, x_max), (y_min, y_max))."""
    (x_min, x_max), (y_min, y_max) = limits
    x, y = points[:, 0], points[:, 1]
    return int(np.sum(~((x >= x_min) & (x <= x_max) & (y >= y_min) & (y <= y_max))))


def draw_run(title, slam, dead_reckoning, truth, landmarks, deviations):
    """The picture of a run as a matplotlib Figure.

    slam, dead_reckoning: (N, 3) positions in m; truth: the same or None. landmarks: (L, 3) m, deviations: (L,)
    horizontal standard deviations in m, one colour each.
    """
    trajectories = [t for t in (slam, dead_reckoning, truth) if t is not None]
    limits = view_limits(trajectories)
    width, height = (high - low for low, high in limits)
    scale = LONG_SIDE / max(width, height)
    figure = Figure(figsize=(scale * width + 2.5, scale * height + 1.8), dpi=130)
    axes = figure.add_subplot()
    if len(landmarks):
        _draw_landmarks(figure, axes, landmarks, deviations, limits)
    if truth is not None:
        axes.plot(truth[:, 0], truth[:, 1], color="black", linewidth=2.6, label="truth", zorder=3)
    axes.plot(dead_reckoning[:, 0], dead_reckoning[:, 1], color="tab:gray", linewidth=1.4, linestyle="--",
              label="dead reckoning", zorder=4)
    axes.plot(slam[:, 0], slam[:, 1], color="tab:red", linewidth=1.4, label="SLAM", zorder=5)
    axes.plot(slam[0, 0], slam[0, 1], color="tab:red", marker="o", markersize=6, markeredgecolor="white",
              linestyle="none", label="start", zorder=6)
    axes.set_aspect("equal")
    axes.set_xlim(*limits[0])
    axes.set_ylim(*limits[1])
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_title(title, fontsize=11)
    axes.grid(True, linewidth=0.4, alpha=0.5)
    axes.set_axisbelow(True)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.6 / (scale * height)), ncol=5, fontsize=9, frameon=False)
    return figure


def save(figure, stream, kind):
    """Write the figure as `kind` ("png" or "svg"); the tight box keeps every label inside the picture."""
    # No date and no random ids: the same run gives the same file.
    with matplotlib.rc_context({"svg.hashsalt": "vi_ekf_slam"}):
        figure.savefig(stream, format=kind, bbox_inches="tight", metadata={"Date": None} if kind == "svg" else None)


def _draw_landmarks(figure, axes, landmarks, deviations, limits):
    usable = np.isfinite(deviations) & (deviations > 0.0)
    outside = count_outside(landmarks, limits)
    if usable.any():
        low, high = np.percentile(deviations[usable], [2.0, 98.0])
        points = axes.scatter(landmarks[usable, 0], landmarks[usable, 1], c=deviations[usable], s=5, linewidths=0,
                              cmap="viridis_r", norm=LogNorm(low, max(high, 1.01 * low)), zorder=2, rasterized=True)
        bar = figure.colorbar(points, ax=axes, shrink=0.8, pad=0.02, extend="both")
        bar.set_label("landmarks: horizontal standard deviation (m)")
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        bar.ax.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
    note = "%d landmarks" % len(landmarks)
    if outside:
        note += ", %d of them outside this view" % outside
    if not usable.all():
        note += ", %d without a valid variance not drawn" % int(np.sum(~usable))
    axes.annotate(note, (0.0, 0.0), xycoords="axes fraction", xytext=(6, 6), textcoords="offset points",
                  fontsize=8, zorder=7,
                  bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "none", "alpha": 0.8})
