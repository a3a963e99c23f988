"""Command line of plot.py: one kind of picture each, by a module of its own."""

import argparse
import importlib

KINDS = {"run": ("vi_ekf_slam.evaluation.run_plotter", "a run from above, and its errors where the truth is known"),
         "maps": ("vi_ekf_slam.evaluation.map_comparison", "the maps of several runs over one bag, side by side"),
         "monte_carlo": ("vi_ekf_slam.simulation.monte_carlo_plotter", "what the program monte_carlo wrote")}


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused."""
    parser = argparse.ArgumentParser(
        prog="plot.py", usage="plot.py {%s} ..." % ",".join(KINDS), formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Draw:\n" + "".join("  %-12s %s\n" % (kind, what) for kind, (_, what) in KINDS.items()),
        epilog="'plot.py KIND --help' explains one.")
    parser.add_argument("kind", choices=KINDS, help=argparse.SUPPRESS)
    parser.add_argument("arguments", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    # Only then: matplotlib is slow to load.
    return importlib.import_module(KINDS[options.kind][0]).main(options.arguments)
