#!/usr/bin/python3
"""Switch off one part of the estimator at a time and tabulate what it costs on the real drives; see --help."""

import argparse
import copy
import csv
import os
import sys
import tempfile

import yaml
from tqdm import tqdm

from vi_ekf_slam.bag.converter import main as convert
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.evaluation.offline_run import judge, run_bag

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DRIVES = ("0027", "0034")

# The paper's filter with its camera switched on and the sensors' true noise.
TUNED_PAPER = {"mode": "slam", "motion_noise": [0.0025, 0.0025, 0.0025, 0.000025, 0.000025, 0.000025], "step_s": 0.1,
               "pixel_noise": 4.0, "prior_pose_variance": 0.0, "prior_landmark_variance": 100.0,
               "landmark_fraction": 0.05, "min_depth_m": 0.5, "max_depth_m": 150.0}

# Name, options of dataset_to_bag.py, what changes in the configuration. The others change the first row.
ROWS = (
    ("full", (), {}),
    ("stale frames not repaired", ("--keep-stale",), {}),
    ("extrinsic not repaired", ("--extrinsic", "given"), {}),
    ("error state of the paper (joint EKF)", (), {"estimator": "paper", "paper": TUNED_PAPER}),
    ("no consensus (RANSAC)", (), {"invariant": {"consensus": False}}),
    ("no twist state", (), {"invariant": {"twist_state": False}}),
)
COLUMNS = ("ATE m", "t_rel %", "r_rel deg/100 m")


def changed(config, changes):
    """`config` with the nested mapping `changes` laid over it."""
    result = copy.deepcopy(config)
    for key, value in changes.items():
        nested = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = changed(result[key], value) if nested else copy.deepcopy(value)
    return result


def numbers(evaluation):
    """The three errors of COLUMNS."""
    return [evaluation.ate, evaluation.kitti.t_rel, evaluation.kitti.r_rel]


def study(data, config, folder, drives, rows, progress):
    """Errors by (row's name, drive): three numbers, or the text of what went wrong; and dead reckoning's by drive."""
    errors, dead_reckoning, bags = {}, {}, {}
    for drive in drives:
        for name, options, changes in rows:
            progress.set_postfix_str("%s, %s" % (drive, name))
            try:
                bag = bags.get((drive, options))
                if bag is None:
                    bag = os.path.join(folder, "%s_%d.bag" % (drive, len(bags)))
                    truth = os.path.join(data, drive + "_truth_left_camera.txt")
                    source = os.path.join(data, drive + ".npz")
                    if convert([source, bag, "--truth", truth, "--quiet", *options]) != 0:
                        raise InputError("%s cannot be converted" % source)
                    bags[drive, options] = bag
                path, output = os.path.join(folder, "config.yaml"), os.path.join(folder, "run")
                with open(path, "w", encoding="utf-8") as stream:
                    yaml.safe_dump(changed(config, changes), stream)
                run_bag(bag, path, output)
                judgement = judge(bag, output)
                errors[name, drive] = numbers(judgement.slam)
                if not options:
                    dead_reckoning[drive] = numbers(judgement.dead_reckoning)
            except InputError as reason:
                errors[name, drive] = str(reason)
            progress.update()
    return errors, dead_reckoning


def table(errors, dead_reckoning, drives, rows):
    """Rows of text: name, three errors a drive."""
    def cells(values):
        return ["%.2f" % v for v in values] if isinstance(values, list) else ["failed"] * len(COLUMNS)
    lines = [["dead reckoning"] + [cell for d in drives for cell in cells(dead_reckoning.get(d))]]
    return lines + [[name] + [cell for d in drives for cell in cells(errors[name, d])] for name, _, _ in rows]


def write(output, header, lines):
    """Write ablation.md and ablation.csv into the directory `output`; returns the Markdown."""
    os.makedirs(output, exist_ok=True)
    markdown = ["| " + " | ".join(line) + " |" for line in [header, ["---"] * len(header)] + lines]
    with open(os.path.join(output, "ablation.md"), "w", encoding="utf-8") as stream:
        stream.write("\n".join(markdown) + "\n")
    with open(os.path.join(output, "ablation.csv"), "w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows([header] + lines)
    return "\n".join(markdown)


def main(argv=None):
    """Entry point: 0 on success, 1 when a row failed (the others are written), 2 when nothing could be done."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", metavar="DATA_DIR", help="directory with the drives (NNNN.npz) and their truth")
    parser.add_argument("output", metavar="OUT", help="directory for ablation.md and ablation.csv, made if needed")
    parser.add_argument("--config", default=os.path.join(ROOT, "config", "default.yaml"), metavar="YAML",
                        help="configuration that the rows change (default: config/default.yaml)")
    parser.add_argument("--drives", nargs="+", default=list(DRIVES), metavar="NNNN",
                        help="default: %s" % " ".join(DRIVES))
    options = parser.parse_args(argv)
    try:
        with open(options.config, encoding="utf-8") as stream:
            config = yaml.safe_load(stream)
    except (OSError, yaml.YAMLError) as reason:
        print("error: %s: cannot be read: %s" % (options.config, reason), file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder, tqdm(total=len(ROWS) * len(options.drives), unit="run",
                                                       disable=not sys.stderr.isatty()) as progress:
        errors, dead_reckoning = study(options.data, config, folder, options.drives, ROWS, progress)
    header = [""] + ["%s %s" % (drive, column) for drive in options.drives for column in COLUMNS]
    print(write(options.output, header, table(errors, dead_reckoning, options.drives, ROWS)))
    failures = {(name, drive): text for (name, drive), text in errors.items() if isinstance(text, str)}
    for (name, drive), text in failures.items():
        print("error: %s, %s: %s" % (drive, name, text), file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
