"""Command line of evaluate.py."""

import argparse
import json
import os

import numpy as np

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output, make_directory, write_text
from vi_ekf_slam.common.stop_signals import signals_unwind
from vi_ekf_slam.dataset.truth import BODIES, MAX_GAP
from vi_ekf_slam.evaluation.against_truth import evaluate, judge_covariances, lacks_orientations
from vi_ekf_slam.evaluation.gauge import GAUGES
from vi_ekf_slam.evaluation.pictures import (
    COMPARISON_PICTURES,
    RUN_PICTURES,
    pictures_of_comparison,
    pictures_of_run,
    remove_pictures,
    save_pictures,
)
from vi_ekf_slam.evaluation.report import DEFINITIONS, Result, table, to_data
from vi_ekf_slam.evaluation.run_inputs import (body_of, default_names, extrinsic_to_compare, find_truth, of_body, read_bag,
                                               read_subject)
from vi_ekf_slam.evaluation.trajectory_export import export

OTHER_UP = np.radians(10.0)  # gravity tells an estimate its tilt far better
LEAST_MATCHED = 0.95  # of the poses, or of the time; where less has truth beside it a remark says so


def make_parser():
    parser = argparse.ArgumentParser(
        prog="evaluate.py",
        description="Judge runs of run_bag, or trajectory files, against the truth: a table, evaluation.json and "
                    "pictures (PNG and SVG). Without truth: pictures, NIS and timing. Without a bag the positions of the "
                    "IMU are compared instead of the left camera's.")
    parser.add_argument("runs", metavar="DIR", nargs="*",
                        help="directory that run_bag or the node wrote, or a trajectory file: TUM, or KITTI (needs "
                             "--bag)")
    parser.add_argument("--bag", action="append", default=[],
                        help="a run's bag, for the extrinsic and for /ground_truth/path (other topics are told by their types "
                             "and names); once for all runs, or once a run")
    parser.add_argument("--truth", action="append", default=[], metavar="FILE",
                        help="true poses, KITTI (12 columns, needs --bag) or TUM (8 columns); goes before the bag's; once "
                             "for all runs, or once a run")
    parser.add_argument("--truth-body", choices=BODIES,
                        help="whose poses --truth holds (default: left_camera for KITTI, imu for TUM)")
    parser.add_argument("--trajectory-body", choices=BODIES,
                        help="whose poses the trajectory files hold (default: left_camera for KITTI, imu for TUM)")
    parser.add_argument("--gauge", choices=GAUGES,
                        help="what of the world frame the estimate chose by itself: pose (all of it), yaw (heading and "
                             "position, since gravity is known), none (it was given a state in the truth's frame); NEES "
                             "is of what is left, and but for pose there are errors after alignment by yaw and position "
                             "(default: as summary.yaml says, else pose)")
    parser.add_argument("--name", action="append", default=[], help="name of a run in table and pictures, once a run")
    parser.add_argument("--output", metavar="OUT",
                        help="directory for everything, made if needed; of several runs each gets OUT/NAME (default: "
                             "each DIR itself; a trajectory file then only appears in the table and in the comparison)")
    parser.add_argument("--streams", metavar="FOLDER",
                        help="instead of runs: take each .npz of FOLDER (simulated IMU, stereo points and truth) through "
                             "run_bag from the state that it gives, and print its errors, beside OpenVINS' where these are known")
    parser.add_argument("--config", metavar="FILE",
                        help="for --streams: the configuration (default: config/default.yaml, with the IMU's calibration)")
    parser.add_argument("--no-plots", action="store_true", help="no pictures")
    parser.add_argument("--export-tum", action="store_true",
                        help="write export/{slam,dead_reckoning,truth}.tum: poses of the IMU with stamps, from a common "
                             "start")
    parser.add_argument("--export-kitti", action="store_true",
                        help="write export/{slam,dead_reckoning,truth}_kitti.txt: poses of the left camera in its "
                             "first frame, row by row; with truth those frames that it reaches. Needs --bag")
    return parser


def run_evaluation(options):
    """Do what the parsed options ask; InputError when something is refused."""
    if bool(options.runs) == bool(options.streams):
        raise InputError("%s given, allowed: DIR ... or --streams FOLDER" % ("both are" if options.runs else "nothing is"))
    _refuse_in_vain(options)
    if options.streams:
        from vi_ekf_slam.evaluation.stream_study import study_streams
        study_streams(options)
        return
    names = _for_each(options.name, options.runs, "--name", shared=False) or default_names(options.runs)
    if len({_file_name(name) for name in names}) < len(names):
        raise InputError("two runs have the same name (%s), allowed: --name with another for each" % ", ".join(names))
    bodies = [body_of(run) for run in options.runs]
    known = next(filter(None, bodies), None)  # of trajectory files beside a run too
    results = [_judge(*arguments, options) for arguments in
               zip(options.runs, names, _for_each(options.bag, options.runs, "--bag"),
                   _for_each(options.truth, options.runs, "--truth"), [body or known for body in bodies])]
    folders = [_folder(options, result.subject, len(results)) for result in results]
    for folder in filter(None, folders):
        check_output(os.path.join(folder, "evaluation.json"))
    runs = [to_data(result) for result in results]
    print("\n".join(table(runs)))
    for line in _remarks(results):
        print(line)
    for result, data, folder in zip(results, runs, folders):
        if folder:
            paths = export(result.subject, os.path.join(folder, "export"), options.export_tum, options.export_kitti)
            print("".join("wrote: %s\n" % path for path in paths), end="")
            if not _keeps_truth(folder, [data]):
                _write_json(folder, dict(data, definitions=DEFINITIONS))
                remove_pictures(folder, RUN_PICTURES)
                _report([] if options.no_plots else pictures_of_run(result), folder)
    if len(results) > 1:
        common = options.output or next(filter(None, folders), None)
        if common and not (options.output and _keeps_truth(common, runs)):
            remove_pictures(common, COMPARISON_PICTURES)
            _report([] if options.no_plots else pictures_of_comparison(results), common)
            if options.output:
                _write_json(common, {"runs": runs, "definitions": DEFINITIONS})


def _refuse_in_vain(options):
    """InputError for an option that says nothing of what is asked for."""
    parser = make_parser()
    for name, value in vars(options).items():
        is_of_streams = name in ("streams", "config")
        if name not in ("runs", "output") and is_of_streams != bool(options.streams) and value != parser.get_default(name):
            raise InputError("--%s is given, allowed %s --streams" % (name.replace("_", "-"), "with" if is_of_streams else "without"))
    if options.trajectory_body and all(os.path.isdir(run) for run in options.runs):
        raise InputError("--trajectory-body is given, allowed for trajectory files; a directory says whose poses it holds")


def _for_each(values, runs, option, shared=True):
    """One of `values` for each run: as many as runs, none, or, where `shared`, one for all."""
    if len(values) == len(runs):
        return values
    if not values:
        return [None] * len(runs) if shared else None
    if shared and len(values) == 1:
        return values * len(runs)
    raise InputError("%s is given %d times, allowed: %sonce for each of the %d runs"
                     % (option, len(values), "once or " if shared else "", len(runs)))


def _judge(path, name, bag, truth_file, body, options):
    """Result of one run or trajectory file. body: of read_bag."""
    if options.truth_body and not truth_file:
        raise InputError("--truth-body needs --truth")
    if options.export_kitti and not bag:
        raise InputError("--export-kitti needs --bag: the files hold poses of the left camera")
    reference = read_bag(bag, body)
    subject = read_subject(path, name, reference, options.trajectory_body, options.gauge)
    subject.bag, subject.truth_body = bag, options.truth_body
    if options.export_kitti and subject.cam_T_imu is None:
        raise InputError("%s: has no extrinsic, which --export-kitti needs" % bag)
    stamps = np.sort(np.concatenate([subject.stamps] + [start for start, _ in subject.map_starts]))
    truth = find_truth(truth_file, options.truth_body, stamps, reference, subject.gauge)
    subject.truth, subject.cam_T_imu = of_body(truth, reference, subject.summary)
    try:
        return judge_subject(subject)
    except InputError as reason:
        raise InputError("%s: %s" % (path, reason))


def judge_subject(subject):
    """Result of a run_inputs.Subject whose truth is known or None."""
    truth, slam, dead, consistency, smoothed, smoothed_consistency = subject.truth, None, None, None, None, None
    later = subject.run.smoothed if subject.run else None
    if truth is not None:
        positions_only = lacks_orientations(subject.poses, truth[1])
        how = (truth, extrinsic_to_compare(subject.cam_T_imu, positions_only, subject.truth_body), subject.gauge, positions_only)
        slam = evaluate(subject.stamps, subject.poses, *how)
        if subject.dead_reckoning:
            dead = evaluate(*subject.dead_reckoning, *how)
        if later:
            smoothed = evaluate(*later, *how)
        truth = None if positions_only else truth  # without orientations it says nothing of the covariances
    frame = (truth, subject.gauge, subject.map_starts)
    if subject.covariances is not None:
        consistency = judge_covariances(subject.stamps, subject.poses, subject.covariances, *frame)
    if later and truth is not None and subject.smoothed_covariances is not None:
        smoothed_consistency = judge_covariances(*later, subject.smoothed_covariances, *frame)
    return Result(subject, slam, dead, consistency, smoothed, smoothed_consistency)


def _remarks(results):
    for result in results:
        subject = result.subject
        for number, poses in enumerate(subject.summary.get("poses_before_resets") or [], 1):
            yield "%s: not judged: the %s poses before a reset, in %s" % (
                subject.name, poses, os.path.join(subject.source, "before_reset_%d" % number))
        if subject.truth is None:
            yield "%s: no truth, so no errors; --truth or a bag with /ground_truth/path gives it" % subject.name
            continue
        poses, seconds = len(subject.stamps), subject.stamps[-1] - subject.stamps[0]
        if result.slam.truth_step:
            yield ("%s: the truth is sparser than the trajectory, %.3g s between its poses: compared at its stamps, with the "
                   "trajectory interpolated; its path is cut short, and a frame of RPE is from one of its poses to the next"
                   % (subject.name, result.slam.truth_step))
            if result.slam.covered < LEAST_MATCHED * seconds:
                yield "%s: the truth covers %.1f of the %.1f s of the trajectory" % (subject.name, result.slam.covered, seconds)
        elif result.slam.matched < LEAST_MATCHED * poses:
            yield "%s: %d of %d poses have no truth beside them: outside of its time, or in a gap of more than %g s" % (
                subject.name, poses - result.slam.matched, poses, MAX_GAP)
        if result.slam.sections[-1]:
            yield "%s: the truth has gaps: the true path and the relative errors leave out what spans one" % subject.name
        if result.slam.positions_only:
            yield ("%s: the truth has one orientation throughout, but the trajectory turns: its positions alone are compared, as "
                   "the %s's" % (subject.name, result.slam.body))
        elif subject.gauge != "pose" and result.slam.tilt > OTHER_UP:
            yield ("%s: upwards is %.0f deg off the truth's, in the median: is z of the truth's world upwards (else --gauge pose), are "
                   "its poses the IMU's (--truth-body), and its quaternions x y z w?" % (subject.name, np.degrees(result.slam.tilt)))
        if subject.cam_T_imu is None:
            yield "%s: no bag with an extrinsic, so positions of the IMU are compared; %s" % (
                subject.name, "%s has no left camera and IMU that /tf_static connects" % subject.bag if subject.bag else
                "--bag gives the left camera's, as KITTI compares them")


def _folder(options, subject, count):
    """Where a run's results go, made if needed; None for a trajectory file without --output."""
    if not options.output:
        return subject.source if subject.run else None
    folder = os.path.join(options.output, _file_name(subject.name)) if count > 1 else options.output
    make_directory(folder)
    return folder


def _file_name(name):
    return os.path.normpath(name).strip("./").replace(os.sep, "_") or "run"


def _keeps_truth(folder, runs):
    """Whether the folder has an evaluation with truth, which these `runs` (data), without any, are not to replace."""
    if any(run["slam"] for run in runs):
        return False
    path = os.path.join(folder, "evaluation.json")
    try:
        with open(path, encoding="utf-8") as stream:
            earlier = json.load(stream)
        kept = any(run["slam"] for run in earlier.get("runs", [earlier]))
    except (OSError, ValueError, AttributeError, KeyError, TypeError):  # none, or no evaluation of ours
        return False
    if kept:
        print("kept: %s and its pictures, made with truth; --truth or --bag gives it, --output another folder" % path)
    return kept


def _write_json(folder, data):
    path = os.path.join(folder, "evaluation.json")
    write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n")
    print("wrote: %s" % path)


def _report(pictures, folder):
    for stem in save_pictures(pictures, folder):
        print("wrote: %s.png, .svg" % stem)


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused, 128 + n after signal n."""
    options = make_parser().parse_intermixed_args(argv)
    with signals_unwind():
        return exit_status(run_evaluation, options)
