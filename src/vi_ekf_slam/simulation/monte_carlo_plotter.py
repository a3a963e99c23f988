"""Command line of plot.py monte_carlo: the picture of what the program monte_carlo wrote."""

import argparse
import os

import numpy as np
from matplotlib.figure import Figure

from vi_ekf_slam.common.csv_columns import read_columns
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output, replacing

FRAME_COLUMNS = ("time", "nees", "nees_rotation", "nees_position", "nis_per_dof", "position_rmse",
                 "dead_reckoning_rmse", "bound_low_6", "bound_high_6", "bound_low_3", "bound_high_3")
SEED_COLUMNS = ("seed", "nis_per_dof", "yaw_variance_fall", "position_rmse", "dead_reckoning_rmse")
NEES_LIMITS = (0.5, 500.0)  # axis; what is far outside is wrong by more than the eye needs to measure


def draw(frames, seeds, title):
    """The picture as a matplotlib Figure. frames, seeds: columns of frames.csv and seeds.csv."""
    figure = Figure(figsize=(9.0, 10.0), dpi=110)
    nees, nis, position = figure.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": (3, 2, 2), "hspace": 0.2})
    count, time = len(seeds["seed"]), frames["time"]
    for dof, color in ((6, "tab:red"), (3, "tab:gray")):
        nees.axhspan(frames["bound_low_%d" % dof][0], frames["bound_high_%d" % dof][0], color=color, alpha=0.15, lw=0,
                     label="95 %% bounds, %d dof" % dof)
    for column, color, label in (("nees", "tab:red", "pose"), ("nees_rotation", "tab:blue", "rotation"),
                                 ("nees_position", "tab:green", "position")):
        nees.plot(time, frames[column], color=color, linewidth=1.2, label=label)
    nees.set_yscale("log")
    finite = frames["nees"][np.isfinite(frames["nees"])]
    top = min(NEES_LIMITS[1], max(15.0, 1.3 * finite.max(initial=1.0)))
    nees.set_ylim(NEES_LIMITS[0], top)
    nees.set_ylabel("mean NEES over %d seeds" % count)
    figure.suptitle(title, fontsize=11, y=0.94)

    nis.axhspan(0.97, 1.03, color="tab:red", alpha=0.15, lw=0, label="1 within 3 %")
    nis.plot(time, frames["nis_per_dof"], color="tab:red", linewidth=0.7, label="frame by frame")
    nis.axhline(np.nanmean(seeds["nis_per_dof"]) if np.isfinite(seeds["nis_per_dof"]).any() else np.nan,
                color="black", linewidth=1.2, linestyle="--", label="mean of the seeds")
    nis.set_ylabel("NIS per degree of freedom")

    position.plot(time, frames["dead_reckoning_rmse"], color="tab:gray", linestyle="--", label="dead reckoning")
    position.plot(time, frames["position_rmse"], color="tab:red", label="estimator")
    position.set_ylabel("position RMS error (m)")
    position.set_xlabel("time (s)")
    position.set_ylim(bottom=0.0)
    for axes in (nees, nis, position):
        axes.grid(True, linewidth=0.4, alpha=0.5, which="both")
        axes.set_axisbelow(True)
        # Above the axes, where no curve can be.
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), fontsize=8, ncol=5, frameon=False, columnspacing=1.0)
    figure.align_ylabels()
    return figure


def plot_monte_carlo(options):
    """Do what the parsed options ask; InputError when something is refused."""
    output = options.output or os.path.join(options.directory, "monte_carlo.png")
    check_output(output, suffix=".png")
    frames = read_columns(os.path.join(options.directory, "frames.csv"), FRAME_COLUMNS)
    seeds = read_columns(os.path.join(options.directory, "seeds.csv"), SEED_COLUMNS)
    title = options.title or "%d simulated drives; global yaw variance falls by %.2g %% at most" % (
        len(seeds["seed"]), 100.0 * seeds["yaw_variance_fall"].max())
    with replacing(output) as stream:
        draw(frames, seeds, title).savefig(stream, format="png", bbox_inches="tight")
    print("wrote: %s" % output)


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused."""
    parser = argparse.ArgumentParser(prog="plot.py monte_carlo",
                                     description="Draw what the program monte_carlo wrote: NEES with its bounds, NIS "
                                                 "and position errors over time.")
    parser.add_argument("directory", metavar="DIR", help="directory that monte_carlo wrote")
    parser.add_argument("--output", metavar="PNG", help="picture to write (default: DIR/monte_carlo.png)")
    parser.add_argument("--title", help="text above the picture")
    return exit_status(plot_monte_carlo, parser.parse_args(argv))
