#!/usr/bin/python3
"""Run growth_benchmark and print its figures as a Markdown table; see --help."""

import argparse
import json
import os
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PROGRAM = os.path.join(ROOT, "build", "devel", "lib", "vi_ekf_slam", "growth_benchmark")
HEADER = ("in view", "out of view", "frame, mean", "frame, median", "frame, longest", "map", "process, peak")


def measure(program, pattern):
    """Figures by (landmarks in view, landmarks out of view). Each case is told on standard error when it is done."""
    with tempfile.NamedTemporaryFile("r", encoding="utf-8", suffix=".json") as report:
        subprocess.run([program, "--benchmark_filter=" + pattern, "--benchmark_out=" + report.name,
                        "--benchmark_out_format=json"], stdout=sys.stderr, check=True)
        return figures(json.load(report))


def figures(report):
    """Those of Google Benchmark's report that the table is made of, by (in view, out of view)."""
    result = {}
    for case in report["benchmarks"]:
        arguments = dict(part.split(":") for part in case["name"].split("/") if ":" in part)
        if not case.get("error_occurred"):
            result[int(arguments["active"]), int(arguments["inactive"])] = case
    return result


def table(cases):
    """Lines of Markdown."""
    lines = ["| " + " | ".join(HEADER) + " |", "| " + " | ".join(["---"] * len(HEADER)) + " |"]
    for (active, inactive), case in sorted(cases.items()):
        lines.append("| %d | %d | %.2f ms | %.2f ms | %.0f ms | %.0f MB | %.0f MB |" % (
            active, inactive, case["real_time"], case["median_ms"], case["worst_ms"], case["map_mb"], case["peak_mb"]))
    lines += ["", "Time with 5000 landmarks out of view over that with 500, mean (median):"]
    for active in sorted({active for active, _ in cases}):
        few, many = cases.get((active, 500)), cases.get((active, 5000))
        if few and many:
            lines.append("%d in view: %.2f (%.2f)" % (active, many["real_time"] / few["real_time"],
                                                      many["median_ms"] / few["median_ms"]))
    return lines


def main(argv=None):
    """Entry point: 0 on success, 2 when the program is not there or fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", default=PROGRAM, help="(default: %(default)s; make -C build growth_benchmark)")
    parser.add_argument("--filter", default=".", metavar="REGEX", help="cases to run, as active:100/inactive:500")
    parser.add_argument("--json", metavar="FILE", help="a report of growth_benchmark, to run nothing")
    options = parser.parse_args(argv)
    try:
        if options.json:
            with open(options.json, encoding="utf-8") as stream:
                cases = figures(json.load(stream))
        else:
            cases = measure(options.program, options.filter)
    except (OSError, subprocess.CalledProcessError) as reason:
        print("error: %s" % reason, file=sys.stderr)
        return 2
    except (ValueError, KeyError, TypeError):  # growth_benchmark writes nothing where it has no case
        print("error: %s, allowed: a report of growth_benchmark" % (
            "%s is none" % options.json if options.json else "--filter is '%s' and gave none" % options.filter), file=sys.stderr)
        return 2
    print("\n".join(table(cases)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
