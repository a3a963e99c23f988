#!/usr/bin/python3
"""Switch off one rule or model of the estimator at a time and tabulate what it costs on the real drives; see --help.

DRIVES and ROWS below are what it runs.
"""

import argparse
import copy
import csv
import glob
import math
import os
import sys
import tempfile
from collections import namedtuple
from concurrent.futures import ProcessPoolExecutor, as_completed

import yaml
from tqdm import tqdm

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.yaml_file import read_mapping
from vi_ekf_slam.evaluation.offline_run import judge, run_bag

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
DATA = os.environ.get("VI_EKF_SLAM_DATA", os.path.join(ROOT, "..", "shared", "data"))
CLEAN = ("--velocity-sigma", "0.1", "--gyro-sigma", "0.01")  # what an INS is worth that nothing was added to
EXTRA = ("0001", "0009", "0036", "0039", "0051", "0095")

Drive = namedtuple("Drive", "name stem truth group options")
Drive.__doc__ = """name: of its column. stem: of its .npz. truth: file. options: of dataset_to_bag.py."""
DRIVES = tuple(
    [Drive(n, n, n + "_truth_left_camera.txt", "recorded", ()) for n in ("0027", "0034")]
    + [Drive(n, "extra_" + n, "extra_%s_truth_left_camera.txt" % n, "clean", CLEAN) for n in EXTRA]
    + [Drive(n + "_noisy", "extra_%s_noisy" % n, "extra_%s_truth_left_camera.txt" % n, "noisy", ()) for n in EXTRA])
GROUPS = ("recorded", "clean", "noisy")

# The paper's filter with its camera switched on and the sensors' true noise.
TUNED_PAPER = {"mode": "slam", "motion_noise": [0.0025, 0.0025, 0.0025, 0.000025, 0.000025, 0.000025], "step_s": 0.1,
               "pixel_noise": 4.0, "prior_pose_variance": 0.0, "prior_landmark_variance": 100.0,
               "landmark_fraction": 0.05, "min_depth_m": 0.5, "max_depth_m": 150.0}
NEVER = 1.0e9  # of a gate

Row = namedtuple("Row", "name options changes")
Row.__doc__ = """options: more of dataset_to_bag.py. changes: laid over the configuration."""
ROWS = (
    Row("full", (), {}),
    Row("stale frames not repaired", ("--keep-stale",), {}),
    Row("extrinsic not repaired", ("--extrinsic", "given"), {}),
    Row("error state of the paper (joint EKF)", (), {"estimator": "paper", "paper": TUNED_PAPER}),
    Row("no biases", ("--velocity-bias-sigma", "1e-6", "--gyro-bias-sigma", "1e-6"), {}),  # the bag's word goes first
    Row("no consensus (RANSAC)", (), {"studies": {"consensus": False}}),
    Row("no plausible gate", (), {"studies": {"plausible_gate": NEVER}}),
    Row("no gate of the frame", (), {"invariant": {"frame_gate": NEVER}}),
    Row("no gate of the motion", (), {"studies": {"motion_gate": NEVER}}),
    Row("points start at their pixels", (), {"studies": {"unbiased_starts": False}}),
    Row("no standstill", (), {"invariant": {"standstill_px": 0.0}}),
    Row("no slip of the tracks", (), {"invariant": {"slip_sigma": 0.0}}),
    Row("error of scale as a variable", (), {"calibration": {"scale_sigma": 0.02}}),
    Row("no search for jumps", (), {"studies": {"divergence_jump_m": 0.0}}),
    Row("no recovery", (), {"invariant": {"divergence_window_s": 0.0}}),
    Row("no landmark kept", (), {"map": {"keep": "none"}}),
)

WORSE = 1.1    # times the error of dead reckoning,
SMALL = 0.005  # or this share of the distance, if that is more: beyond it a drive counts as not coped with

Errors = namedtuple("Errors", "ate t_rel r_rel")
Result = namedtuple("Result", "slam dead_reckoning limit")
Result.__doc__ = """slam, dead_reckoning: Errors. limit: m of ATE beyond which the drive counts as not coped with."""
FIGURES = (("ATE in m", "ate"), ("t_rel in %", "t_rel"))


def changed(config, changes):
    """`config` with the nested mapping `changes` laid over it."""
    result = copy.deepcopy(config)
    for key, value in changes.items():
        nested = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = changed(result[key], value) if nested else copy.deepcopy(value)
    return result


def check_keys(rows, known):
    """InputError that names the first row with a key that is not in the mapping `known`."""
    def unknown(changes, among, path):
        for key, value in changes.items():
            if key not in among:
                yield ".".join(path + [key])
            elif isinstance(value, dict):
                yield from unknown(value, among[key] if isinstance(among[key], dict) else {}, path + [key])
    for row in rows:
        for key in unknown(row.changes, known, []):
            raise InputError("row '%s': there is no configuration key '%s'" % (row.name, key))


def make_bag(data, drive, options, bag):
    """Convert a drive."""
    arguments = [os.path.join(data, drive.stem + ".npz"), bag, "--truth", os.path.join(data, drive.truth), "--quiet",
                 *drive.options, *options]
    if convert(arguments) != 0:
        raise InputError("%s cannot be converted" % arguments[0])


def run(bag, config):
    """The Result of a bag under a configuration."""
    with tempfile.TemporaryDirectory() as folder:
        path, output = os.path.join(folder, "config.yaml"), os.path.join(folder, "run")
        with open(path, "w", encoding="utf-8") as stream:
            yaml.safe_dump(config, stream)
        run_bag(bag, path, output)
        judgement = judge(bag, output)
    slam, dead = (Errors(e.ate, e.kitti.t_rel, e.kitti.r_rel) for e in (judgement.slam, judgement.dead_reckoning))
    return Result(slam, dead, max(WORSE * dead.ate, SMALL * judgement.way))


def gather(futures, progress):
    """Results by key of `futures` (future -> key); the text of an InputError where there is none."""
    results = {}
    for future in as_completed(futures):
        try:
            results[futures[future]] = future.result()
        except InputError as reason:
            results[futures[future]] = str(reason)
        progress.update()
    return results


def study(data, config, drives, rows, jobs, progress):
    """Results by (row's name, drive's name), or the text of what went wrong. Each bag is converted once."""
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(jobs) as pool:
        wanted = sorted({(drive, row.options) for drive in drives for row in rows}, key=str)
        bags = {want: os.path.join(folder, "%d.bag" % i) for i, want in enumerate(wanted)}
        progress.total = len(wanted) + len(drives) * len(rows)
        made = gather({pool.submit(make_bag, data, *want, bags[want]): want for want in wanted}, progress)
        results = {(row.name, drive.name): made[drive, row.options]
                   for row in rows for drive in drives if made[drive, row.options] is not None}
        progress.update(len(results))
        results.update(gather({pool.submit(run, bags[drive, row.options], changed(config, row.changes)):
                               (row.name, drive.name) for row in rows for drive in drives
                               if (row.name, drive.name) not in results}, progress))
    return results


def mean(values):
    """Of those that are finite; nan where none is."""
    finite = [v for v in values if math.isfinite(v)]
    return sum(finite) / len(finite) if finite else float("nan")


def cell(value):
    """A number as text; sub-sequences of 100 m do not fit into every drive."""
    return "%.2f" % value if math.isfinite(value) else "-"


def line(name, errors, drives, limits=None):
    """A row of text: name, `errors` by drive's name (text where there is none), their means by group, and how many are
    beyond their `limits`. A mean over fewer drives than there are is none.
    """
    cells, beyond = [name], 0
    for drive in drives:
        error = errors[drive.name]
        cells.append("failed" if isinstance(error, str) else cell(error))
        beyond += isinstance(error, str) or (limits is not None and error > limits[drive.name])
    for group in groups_of(drives):
        of_group = [errors[d.name] for d in drives if d.group == group]
        cells.append("-" if any(isinstance(e, str) for e in of_group) else cell(mean(of_group)))
    return cells + ([] if limits is None else [str(beyond)])


def groups_of(drives):
    """Those that there are, in their order."""
    return [group for group in GROUPS if any(d.group == group for d in drives)]


def table(results, figure, drives, rows):
    """Header and rows of text of one figure (a field of Errors). Dead reckoning is that of the first row that ran."""
    def of(row, part):
        found = {d.name: results[row.name, d.name] for d in drives}
        return {n: r if isinstance(r, str) else getattr(getattr(r, part), figure) for n, r in found.items()}

    def limits(row):
        return {d.name: getattr(results[row.name, d.name], "limit", math.inf) for d in drives} if figure == "ate" else None
    header = [""] + [d.name.replace("_", " ") for d in drives] + ["mean " + group for group in groups_of(drives)]
    header += ["beyond the limit"] if figure == "ate" else []
    reference = next((row for row in rows if not row.options), rows[0])
    lines = [line("dead reckoning", of(reference, "dead_reckoning"), drives)]
    lines[0] += [""] * (len(header) - len(lines[0]))
    return header, lines + [line(row.name, of(row, "slam"), drives, limits(row)) for row in rows]


def markdown(header, lines):
    """As a table of Markdown."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [header, ["---"] * len(header)] + lines)


def write(output, text, results, drives, rows):
    """Write ablation.md and ablation.csv (a line a run) into the directory `output`."""
    os.makedirs(output, exist_ok=True)
    with open(os.path.join(output, "ablation.md"), "w", encoding="utf-8") as stream:
        stream.write(text + "\n")
    with open(os.path.join(output, "ablation.csv"), "w", encoding="utf-8", newline="") as stream:
        out = csv.writer(stream)
        out.writerow(["row", "drive", "group"] + list(Errors._fields)
                     + ["dead_reckoning_" + field for field in Errors._fields] + ["limit_ate"])
        for row in rows:
            for drive in drives:
                result = results[row.name, drive.name]
                if not isinstance(result, str):
                    out.writerow([row.name, drive.name, drive.group, *result.slam, *result.dead_reckoning, result.limit])


def choose(things, wanted, what):
    """Those of `things` whose name, stem or group is in `wanted`, or all where that is None."""
    def names(thing):
        return {getattr(thing, field, thing.name) for field in ("name", "stem", "group")}
    if wanted is None:
        return things
    for word in wanted:
        if not any(word in names(thing) for thing in things):
            raise InputError("there is no %s '%s'; there are: %s" % (what, word, ", ".join(t.name for t in things)))
    return tuple(thing for thing in things if names(thing) & set(wanted))


def parse(argv):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], epilog=(
        "The last column counts the drives whose ATE is beyond the larger of %g times that of dead reckoning and %g %% of "
        "the distance. Exit code: 0; 1 when a run failed (the others are written); 2 when nothing could be done."
        % (WORSE, 100.0 * SMALL)).replace("%", "%%"))
    parser.add_argument("data", metavar="DATA_DIR", nargs="?", default=DATA,
                        help="directory with the drives and their truth (default: $VI_EKF_SLAM_DATA or ../shared/data)")
    parser.add_argument("output", metavar="OUT", help="directory for ablation.md and ablation.csv, made if needed")
    parser.add_argument("--config", default=os.path.join(ROOT, "config", "default.yaml"), metavar="YAML",
                        help="configuration that the rows change (default: config/default.yaml)")
    parser.add_argument("--drives", nargs="+", metavar="NAME",
                        help="of these: %s; or whole groups: %s" % (" ".join(d.name for d in DRIVES), " ".join(GROUPS)))
    parser.add_argument("--rows", nargs="+", metavar="NAME", help="of these: %s" % ", ".join("'%s'" % r.name for r in ROWS))
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (default: %(default)s)")
    return parser.parse_args(argv)


def main(argv=None):
    """Entry point; see --help for what it returns."""
    options = parse(argv)
    try:
        config = read_mapping(options.config)
        known = config
        for path in sorted(glob.glob(os.path.join(ROOT, "config", "*.yaml"))):
            known = changed(known, read_mapping(path))
        drives, rows = choose(DRIVES, options.drives, "drive"), choose(ROWS, options.rows, "row")
        check_keys(rows, known)
        if options.jobs < 1:
            raise InputError("--jobs is %d, allowed: from 1" % options.jobs)
        if not os.path.isdir(options.data):
            raise InputError("%s: is not a directory, allowed: one that holds the drives" % options.data)
    except InputError as reason:
        print("error: %s" % reason, file=sys.stderr)
        return 2
    with tqdm(unit="step", disable=not sys.stderr.isatty()) as progress:
        results = study(options.data, config, drives, rows, options.jobs, progress)
    text = "\n\n".join("%s\n\n%s" % (title, markdown(*table(results, figure, drives, rows))) for title, figure in FIGURES)
    write(options.output, text, results, drives, rows)
    print(text)
    failures = {key: text for key, text in results.items() if isinstance(text, str)}
    for (row, drive), reason in failures.items():
        print("error: %s, %s: %s" % (row, drive, reason), file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
