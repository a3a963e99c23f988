"""Command line of plot.py run."""

import argparse
import os

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output, replacing
from vi_ekf_slam.dataset.truth import BODIES
from vi_ekf_slam.evaluation.against_truth import (anchor_truth, describe, evaluate, lacks_orientations, title_of_errors,
                                                  truth_line)
from vi_ekf_slam.evaluation.gauge import gauge_of
from vi_ekf_slam.evaluation.run_inputs import extrinsic_to_compare, find_truth, of_body, read_bag
from vi_ekf_slam.evaluation.run_io import read_run


def make_parser():
    parser = argparse.ArgumentParser(
        prog="plot.py run",
        description="Draw a run of run_bag from above and, where the truth is known, print its errors (ATE; KITTI's "
                    "t_rel and r_rel over 100 to 800 m).")
    parser.add_argument("run", metavar="DIR", help="directory that run_bag wrote")
    parser.add_argument("--bag", help="the run's bag, for the extrinsic and for /ground_truth/path if it has one")
    parser.add_argument("--truth", metavar="FILE",
                        help="true poses, KITTI (12 columns, needs --bag) or TUM (8 columns); goes before the bag's")
    parser.add_argument("--truth-body", choices=BODIES,
                        help="whose poses --truth holds (default: left_camera for KITTI, imu for TUM)")
    parser.add_argument("--dead-reckoning", metavar="DIR2", help="take dead_reckoning.tum from this run instead")
    parser.add_argument("--name", help="name of the drive for the title (default: the bag's or else the directory's)")
    parser.add_argument("--output", metavar="PNG", help="picture to write (default: DIR/run.png)")
    parser.add_argument("--svg", action="store_true", help="write the picture as .svg beside it as well")
    return parser


def plot_run(options):
    """Do what the parsed options ask; InputError when something is refused."""
    if options.truth_body and not options.truth:
        raise InputError("--truth-body needs --truth")
    run = read_run(options.run, options.dead_reckoning)
    outputs = _outputs(options)
    reference = read_bag(options.bag, run.summary.get("body"))
    gauge = gauge_of(run.summary)
    truth = find_truth(options.truth, options.truth_body, run.stamps, reference, gauge)
    truth, cam_T_imu = of_body(truth, reference, run.summary)

    title, line = _name(options), None
    if truth:
        positions_only = lacks_orientations(run.poses, truth[1])
        how = (truth, extrinsic_to_compare(cam_T_imu, positions_only, options.truth_body), "pose", positions_only)
        slam = evaluate(run.stamps, run.poses, *how)
        dead = evaluate(run.dead_stamps, run.dead_poses, *how)
        print(describe("slam", slam))
        print(describe("dead reckoning", dead))
        if run.smoothed:
            print(describe("smoothed", evaluate(*run.smoothed, *how)))
        title += "\n" + title_of_errors(slam, dead)
        if not positions_only:
            line = truth_line(truth[0], anchor_truth(truth, run.stamps, run.poses, gauge))

    from vi_ekf_slam.evaluation import top_view  # matplotlib is slow to load; complain about inputs first
    figure = top_view.draw_run(top_view.plain(title), run.poses[:, :3, 3], run.dead_poses[:, :3, 3], line,
                               run.landmarks, run.horizontal_deviations(), smoothed=run.smoothed and run.smoothed[1][:, :3, 3])
    for path, kind in outputs:
        with replacing(path) as stream:
            top_view.save(figure, stream, kind)
        print("wrote: %s" % path)


def _outputs(options):
    png = options.output or os.path.join(options.run, "run.png")
    check_output(png, suffix=".png")
    if not options.svg:
        return [(png, "png")]
    svg = os.path.splitext(png)[0] + ".svg"
    check_output(svg)
    return [(png, "png"), (svg, "svg")]


def _name(options):
    source = options.bag or os.path.abspath(options.run)
    return options.name or os.path.splitext(os.path.basename(source))[0]


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused."""
    return exit_status(plot_run, make_parser().parse_args(argv))
