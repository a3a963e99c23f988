"""Command line of reproduce_paper.py."""

import argparse
import json
import os
import shlex
import sys
import tempfile

import yaml
from tqdm import tqdm

from vi_ekf_slam.bag import converter
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output, make_directory, replacing, write_text
from vi_ekf_slam.common.package_files import package_file
from vi_ekf_slam.common.stop_signals import signals_unwind
from vi_ekf_slam.common.yaml_file import read_text, read_yaml
from vi_ekf_slam.evaluation.against_truth import describe
from vi_ekf_slam.evaluation.offline_run import run_bag
from vi_ekf_slam.evaluation.report import DEFINITIONS, to_data
from vi_ekf_slam.evaluation.run_evaluator import judge_subject
from vi_ekf_slam.evaluation.run_inputs import read_bag, read_subject
from vi_ekf_slam.paper.figures import DRIVES, KINDS, METHODS, SIDES, draw_pair, figures_of, picture_name, to_bytes
from vi_ekf_slam.paper.page import make_page

PAGE, NUMBERS = "reproduce_paper.html", "reproduce_paper.json"
TRUTH_SUFFIX = "_truth_left_camera.txt"
PICTURE_TYPES = ("png", "svg")


def make_parser():
    parser = argparse.ArgumentParser(
        prog="reproduce_paper.py",
        description="Make figures 1 to 9 of the paper (dead reckoning, visual map and SLAM for the drives %s), with "
                    "the paper's filter and with ours beside it: pictures, their numbers, and an HTML page that holds "
                    "all of it in one file. Drives that are not in DATA_DIR are left out." % ", ".join(DRIVES))
    parser.add_argument("data", metavar="DATA_DIR", help="directory with the drives (NNNN.npz) and, where it is known, "
                        "their truth (NNNN%s)" % TRUTH_SUFFIX)
    parser.add_argument("output", metavar="OUT_DIR", help="directory for %s and all else, made if needed" % PAGE)
    parser.add_argument("--config", metavar="YAML", help="configuration of our filter (default: config/default.yaml)")
    parser.add_argument("--quiet", action="store_true", help="no report and no progress bar")
    return parser


def find_drives(data):
    """Names of the paper's drives in the directory `data`; InputError when there is none."""
    if not os.path.isdir(data):
        raise InputError("%s: is not a directory, allowed: one that holds drives (NNNN.npz)" % data)
    drives = [name for name in DRIVES if os.path.lexists(os.path.join(data, name + ".npz"))]
    if not drives:
        raise InputError("%s: holds none of the paper's drives, allowed: at least one of %s"
                         % (data, ", ".join(name + ".npz" for name in DRIVES)))
    return drives


def make_configurations(ours):
    """{name: text} of the configurations that METHODS name. ours: path of our filter's."""
    paper = read_yaml(package_file("config", "paper.yaml"))
    texts = {"ours": read_text(ours)}
    for method in METHODS.values():
        if method.mode is not None:
            paper["paper"]["mode"] = method.mode
            texts[method.config] = "# config/paper.yaml with the mode %s\n%s" % (
                method.mode, yaml.safe_dump(paper, sort_keys=False, default_flow_style=False))
    return texts


def truth_of(data, drive):
    """Path of a drive's truth, or None."""
    path = os.path.join(data, drive + TRUTH_SUFFIX)
    return path if os.path.lexists(path) else None


def run_name(drive, method):
    """Name of the directory of a drive's run by one of METHODS."""
    return "%s_%s" % (drive, method)


def commands_of(drive, method, has_truth):
    """Lines for a shell in which DATA_DIR and OUT_DIR are set that give the run and its numbers again."""
    convert = 'rosrun vi_ekf_slam dataset_to_bag.py "$DATA_DIR/%s.npz" %s.bag' % (drive, drive)
    if has_truth:
        convert += ' --truth "$DATA_DIR/%s%s"' % (drive, TRUTH_SUFFIX)
    run = run_name(drive, method)
    options = "".join(" " + shlex.quote(word) for word in METHODS[method].options)
    return [convert,
            'rosrun vi_ekf_slam run_bag %s.bag --config "$OUT_DIR/%s.yaml" --output %s%s'
            % (drive, METHODS[method].config, run, options),
            "rosrun vi_ekf_slam evaluate.py %s --bag %s.bag" % (run, drive)]


def convert_drives(data, drives, folder, progress):
    """Write a bag for each drive into `folder`; all of them, so that a bad one is complained about early."""
    for drive in drives:
        progress.set_description_str("%s: converting" % drive)
        words = [os.path.join(data, drive + ".npz"), os.path.join(folder, drive + ".bag"), "--quiet"]
        truth = truth_of(data, drive)
        converter.convert(converter.make_parser().parse_args(words + (["--truth", truth] if truth else [])))
        progress.update()


def judge_drive(drive, folder, configurations, progress):
    """Run all METHODS on a drive's bag in `folder`. configurations: {name: path}.

    Returns {method: evaluation.report.Result}.
    """
    bag = os.path.join(folder, drive + ".bag")
    reference, results = read_bag(bag), {}
    for name, method in METHODS.items():
        progress.set_description_str("%s, %s" % (drive, method.label))
        output = os.path.join(folder, run_name(drive, name))
        run_bag(bag, configurations[method.config], output, *method.options)
        subject = read_subject(output, method.label, reference)
        subject.truth = reference.truth
        results[name] = judge_subject(subject)
        progress.update()
    return results


def draw_all(drives, results, progress):
    """{(figure's number, side): {"png", "svg": bytes}}. results: {drive: of judge_drive}."""
    files = {}
    for figure in figures_of(drives):
        progress.set_description_str("figure %d" % figure.number)
        pictures = draw_pair(figure, [results[figure.drive][method] for method in figure.kind.methods])
        for side, picture in zip(SIDES, pictures):
            files[figure.number, side] = {kind: to_bytes(picture, kind) for kind in PICTURE_TYPES}
        progress.update()
    return files


def reproduce(options):
    """Do what the parsed options ask; InputError when something is refused. Nothing is written before all is made."""
    drives = find_drives(options.data)
    missing = [drive for drive in DRIVES if drive not in drives]
    say = (lambda text: None) if options.quiet else print
    if missing:
        say("not in %s, left out: %s" % (options.data, ", ".join(missing)))
    ours = options.config or package_file("config", "default.yaml")
    configurations = make_configurations(ours)
    make_directory(options.output)
    for path in _outputs(options.output, configurations):
        check_output(path)

    with tempfile.TemporaryDirectory(prefix="reproduce_paper_") as folder, \
            tqdm(total=len(drives) * (1 + len(METHODS) + len(KINDS)), unit="step",
                 disable=options.quiet or not sys.stderr.isatty()) as progress:
        paths = {name: os.path.join(folder, name + ".yaml") for name in configurations}
        for name, path in paths.items():
            write_text(path, configurations[name])
        paths["ours"] = ours  # itself, so that a complaint names it
        convert_drives(options.data, drives, folder, progress)
        results = {drive: judge_drive(drive, folder, paths, progress) for drive in drives}
        pictures = draw_all(drives, results, progress)
    for drive in drives:
        for result in results[drive].values():
            if result.slam:
                say(describe("%s, %s" % (drive, result.subject.name), result.slam))
    _write(options, drives, results, configurations, pictures, say)


def _outputs(folder, configurations):
    names = [PAGE, NUMBERS] + [name + ".yaml" for name in configurations]
    names += ["%s.%s" % (picture_name(figure.number, side), kind)
              for figure in figures_of(DRIVES) for side in SIDES for kind in PICTURE_TYPES]
    return [os.path.join(folder, name) for name in names]


def _write(options, drives, results, configurations, pictures, say):
    """Put everything into OUT_DIR, the page last, and take away what an earlier call left of drives now missing."""
    numbers = {}
    for drive in drives:
        numbers[drive] = {}
        for name, result in results[drive].items():
            data = dict(to_data(result), commands=commands_of(drive, name, truth_of(options.data, drive) is not None))
            del data["source"]  # a directory that is gone by now
            numbers[drive][name] = data
    setting = [("DATA_DIR", os.path.abspath(options.data)), ("OUT_DIR", os.path.abspath(options.output))]
    embedded = {key: files["png"] for key, files in pictures.items()}
    contents = {name + ".yaml": text.encode("utf-8") for name, text in configurations.items()}
    for (number, side), files in pictures.items():
        contents.update(("%s.%s" % (picture_name(number, side), kind), data) for kind, data in files.items())
    contents[NUMBERS] = (json.dumps({"drives": numbers, "missing": [d for d in DRIVES if d not in drives],
                                     "definitions": DEFINITIONS}, indent=2, allow_nan=False) + "\n").encode("utf-8")
    contents[PAGE] = make_page(drives, numbers, configurations, embedded, setting).encode("utf-8")
    for name, data in contents.items():
        with replacing(os.path.join(options.output, name)) as stream:
            stream.write(data)
    for path in _outputs(options.output, configurations):
        if os.path.basename(path) not in contents and os.path.exists(path):
            os.unlink(path)
            say("removed: %s, of a drive that is not there now" % path)
    say("wrote: %s, with %d pictures beside it" % (os.path.join(options.output, PAGE), len(pictures)))


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused, 128 + n after signal n."""
    options = make_parser().parse_args(argv)
    with signals_unwind():
        return exit_status(reproduce, options, source=options.data)
