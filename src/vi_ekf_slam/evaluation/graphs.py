"""Pictures of an evaluation over time and over distance. Figures of matplotlib, without a display."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from vi_ekf_slam.evaluation.against_truth import with_breaks
from vi_ekf_slam.evaluation.consistency import POSE_AXES, chi_square_bounds
from vi_ekf_slam.evaluation.metrics import KITTI_LENGTHS, mean_kitti_errors
from vi_ekf_slam.evaluation.run_io import FRAME_TIME
from vi_ekf_slam.evaluation.top_view import DASHES, DEAD_RECKONING_ON_TOP, SLAM_STYLE

NEES_FLOOR = 0.1  # of the axis; below it an error is of no interest
START_S = 10.0  # s at the beginning that have panels of their own, in drives that are three times as long at least
SAWTOOTH = (
    "Sawtooth: tracks are lost one by one, until the front end detects anew. In %d frames nothing is used because all ids are\n"
    "new: so dataset_to_bag.py repairs stale frames, which repeat the pixels of the frame before.")


def draw_errors(title, consistency):
    """Errors with their 3-sigma bounds for x, y, z, roll, pitch, yaw, then the NEES; bounds alone without truth.

    Bounds grow, so that what happens in the first START_S is drawn once more, to its own scale, beside each.
    """
    rows = 3 if consistency.nees is None else 4
    consistency = consistency._replace(**{
        name: values if values is None else with_breaks(consistency.sections, values)
        for name, values in consistency._asdict().items() if name != "sections"})
    time = np.fmax.accumulate(consistency.stamps - consistency.stamps[0])  # a break is at the moment before it
    has_start = time[-1] >= 3.0 * START_S
    figure = Figure(figsize=(17.0 if has_start else 12.0, 2.7 * rows + 0.6), dpi=110)
    grid = figure.add_gridspec(rows, 4, hspace=0.5, wspace=0.33, top=0.92, width_ratios=[2.2, 1.0] * 2) if has_start \
        else figure.add_gridspec(rows, 2, hspace=0.5, wspace=0.2, top=0.92)
    start = time <= START_S
    for k, name in enumerate(POSE_AXES):
        for column, part in enumerate((slice(None), start) if has_start else (slice(None),)):
            axes = figure.add_subplot(grid[k % 3, (k // 3) * (2 if has_start else 1) + column])
            _draw_error(axes, k, time[part], consistency, part)
            if column == 0:
                axes.set_ylabel("%s (%s)" % (name, "m" if k < 3 else "deg"))
            elif k % 3 == 0:
                axes.set_title("the first %g s" % START_S, fontsize=9)
            _finish(axes, time[part], legend=column == 0 and k in (0, 3))
            if k % 3 == 2:
                axes.set_xlabel("time (s)")
    if consistency.nees is not None:
        _draw_nees(figure.add_subplot(grid[3, :3] if has_start else grid[3, :]), time, consistency, slice(None))
        if has_start:
            axes = figure.add_subplot(grid[3, 3])
            _draw_nees(axes, time, consistency, start)
            axes.set_ylabel("")
    figure.align_ylabels()
    figure.suptitle(title, fontsize=11, y=0.97)
    return figure


def _draw_error(axes, k, time, consistency, part):
    scale = 1.0 if k < 3 else np.degrees(1.0)
    bound = 3.0 * scale * consistency.deviations[part, k]
    axes.fill_between(time, -bound, bound, color="tab:blue", alpha=0.2, linewidth=0, label="3 sigma")
    if consistency.errors is not None:
        axes.plot(time, scale * consistency.errors[part, k], color="tab:red", linewidth=1.0,
                  label="error (estimate - truth)")


def _draw_nees(axes, time, consistency, part):
    time, whole = time[part], isinstance(part, slice)
    low, high = chi_square_bounds(6)
    axes.axhspan(low, high, color="tab:red", alpha=0.15, linewidth=0, label="95 % bounds, 6 dof")
    for values, color, label in ((consistency.nees, "tab:red", "pose"),
                                 (consistency.nees_rotation, "tab:blue", "rotation (3 dof)"),
                                 (consistency.nees_position, "tab:green", "position (3 dof)")):
        axes.plot(time, np.maximum(values[part], NEES_FLOOR), color=color, linewidth=1.0, label=label)
    axes.set_yscale("log")
    axes.set_ylim(bottom=NEES_FLOOR)
    axes.set_ylabel("error squared over\ncovariance (NEES)")
    axes.set_xlabel("time (s)")
    _finish(axes, time, legend=whole)


def draw_frames(title, frames):
    """Features, NIS per degree of freedom and frame time over time. frames: of run_io.read_frames."""
    panels = 3 if FRAME_TIME in frames else 2
    figure = Figure(figsize=(11.0, 2.9 * panels + 0.8), dpi=110)
    grid = figure.subplots(panels, 1, sharex=True, gridspec_kw={"hspace": 0.25, "top": 0.91})
    time = frames["stamp"] - frames["stamp"][0]
    features = grid[0]
    for column, color, label in (("features", "tab:gray", "in the frame"), ("used", "tab:green", "inliers (used)"),
                                 ("rejected", "tab:red", "rejected")):
        features.plot(time, frames[column], color=color, linewidth=1.0, label=label)
    refused = time[frames["frame_rejected"] > 0.0]
    if len(refused):
        features.plot(refused, np.zeros(len(refused)), color="black", marker="x", markersize=5, linestyle="none",
                      clip_on=False, label="frame rejected (%d)" % len(refused))
    features.set_ylim(bottom=0.0)
    features.set_ylabel("features in a frame")
    _draw_nis(grid[1], time, frames)
    if panels == 3:
        milliseconds = frames[FRAME_TIME]
        grid[2].plot(time, milliseconds, color="tab:blue", linewidth=0.8, label="each frame")
        for value, style, label in ((np.median(milliseconds), "-", "median %.2f ms"),
                                    (np.percentile(milliseconds, 95.0), "--", "95 %%: %.2f ms")):
            grid[2].axhline(value, color="black", linewidth=1.0, linestyle=style, label=label % value)
        grid[2].set_ylim(bottom=0.0)
        grid[2].set_ylabel("time to compute\na frame (ms)")
    for axes in grid:
        _finish(axes, time)
    grid[-1].set_xlabel("time (s)")
    figure.align_ylabels()
    figure.suptitle(title, fontsize=11, y=0.97)
    if _frames_of_new_tracks(frames):
        figure.text(0.5, 0.06, SAWTOOTH % _frames_of_new_tracks(frames), ha="center", va="top", fontsize=9)
    return figure


def _frames_of_new_tracks(frames):
    """Frames that have features and use none of them without having been rejected: all their ids are new, as those of the
    first one are on any drive, which does not count."""
    seen = frames["features"] > 0.0
    new = seen & (frames["used"] == 0.0) & (frames["frame_rejected"] == 0.0)
    return int(np.sum(new[np.argmax(seen) + 1:]))


def _draw_nis(axes, time, frames):
    dof = np.where(frames["nis_dof"] > 0.0, frames["nis_dof"], np.nan)
    axes.set_ylabel("innovation squared over\ncovariance, per dof (NIS)")
    if np.isnan(dof).all():
        axes.text(0.5, 0.5, "no features were used", transform=axes.transAxes, ha="center", va="center")
        axes.set_yticks([])
        return
    low, high = (bound / dof for bound in chi_square_bounds(dof))
    axes.fill_between(time, low, high, color="tab:red", alpha=0.2, linewidth=0, label="95 % bounds")
    axes.plot(time, frames["nis"] / dof, color="tab:red", linewidth=0.8, label="each frame")
    mean = np.nansum(frames["nis"]) / np.nansum(dof)
    axes.axhline(mean, color="black", linewidth=1.0, linestyle="--", label="all frames: %.3f" % mean)
    axes.set_ylim(bottom=0.0)


def draw_drift(title, lines):
    """Position error over distance, and KITTI's errors by length. lines: (label, against_truth.Evaluation, style)."""
    figure = Figure(figsize=(11.0, 8.0), dpi=110)
    grid = figure.add_gridspec(2, 2, hspace=0.35, wspace=0.22, top=0.91)
    error = figure.add_subplot(grid[0, :])
    for label, evaluation, style in lines:
        error.plot(*(with_breaks(evaluation.sections, values) for values in (evaluation.distance, evaluation.error)),
                   label=label, **style)
    error.set_xlim(0.0, max(evaluation.way for _, evaluation, _ in lines))
    error.set_ylim(bottom=0.0)
    error.set_xlabel("distance along the truth (m)")
    error.set_ylabel("position error (m)")
    _finish(error)
    for k, (ylabel, column) in enumerate((("translation error, t_rel (%)", 0), ("rotation error, r_rel (deg/100 m)", 1))):
        axes, highest = figure.add_subplot(grid[1, k]), 0.0
        for label, evaluation, style in lines:
            rows = evaluation.segments
            lengths = [length for length in KITTI_LENGTHS if (rows[:, 0] == length).any()]
            values = [mean_kitti_errors(rows[rows[:, 0] == length])[column] for length in lengths]
            highest = max([highest] + values)
            axes.plot(lengths, values, marker="o", markersize=4, label=label, **style)
        if all(len(evaluation.segments) == 0 for _, evaluation, _ in lines):
            axes.text(0.5, 0.5, "too short for sub-sequences of 100 m", transform=axes.transAxes, ha="center",
                      va="center")
        axes.set_xlim(KITTI_LENGTHS[0] - 50.0, KITTI_LENGTHS[-1] + 50.0)
        axes.set_ylim(0.0, 1.1 * max(highest, 1e-3))
        axes.set_xlabel("length of sub-sequence (m)")
        axes.set_ylabel(ylabel)
        _finish(axes, legend=False)
    figure.suptitle(title, fontsize=11, y=0.97)
    return figure


def line_styles(count, repeats=()):
    """A style for each of `count` runs that share a picture; one alone is drawn as everywhere.

    Each is thinner than the one before, so that of nearly equal lines all are seen. repeats: of each run whether it is the
    same as one before it; those are dashed.
    """
    if count == 1:
        return [SLAM_STYLE]
    colors = ["tab:red", "tab:blue", "tab:green", "tab:orange", "tab:purple", "tab:brown", "tab:pink", "tab:olive"]
    styles = [dict(SLAM_STYLE, color=colors[k % len(colors)], linestyle=("-", "-.", ":")[k // len(colors) % 3],
                   linewidth=max(1.0, 3.4 - 0.8 * k)) for k in range(count)]
    return [dict(style, linestyle=DASHES) if repeat else style
            for style, repeat in zip(styles, list(repeats) or [False] * count)]


def drift_lines(dead_reckoning, runs, repeats=()):
    """The lines of draw_drift: one dead reckoning or None, then (label, Evaluation) of each run. repeats: of line_styles."""
    lines = [("dead reckoning", dead_reckoning, DEAD_RECKONING_ON_TOP)] if dead_reckoning is not None else []
    return lines + [(label, evaluation, style) for (label, evaluation), style in zip(runs, line_styles(len(runs), repeats))]


def _finish(axes, time=None, legend=True):
    axes.grid(True, linewidth=0.4, alpha=0.5)
    axes.set_axisbelow(True)
    if axes.get_yscale() == "linear" and len(axes.get_yticks()):
        axes.yaxis.set_major_formatter(ScalarFormatter(useOffset=False))
    if time is not None and time[-1] > time[0]:
        axes.set_xlim(time[0], time[-1])
    if legend and axes.get_legend_handles_labels()[0]:  # above the axes, where no curve can be
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), fontsize=8, ncol=5, frameon=False, borderpad=0.1,
                    columnspacing=1.2)
