"""The pictures of an evaluation, by name."""

import contextlib
import os

import numpy as np

from vi_ekf_slam.common.output_file import check_output, replacing
from vi_ekf_slam.evaluation.against_truth import align, anchor_truth, panel_titles, truth_line
from vi_ekf_slam.evaluation.run_inputs import meets

RUN_PICTURES = ("trajectory", "landmarks", "errors", "frames", "drift")
COMPARISON_PICTURES = ("comparison", "comparison_drift")

# matplotlib is slow to load, so the functions that draw load it: inputs are complained about first.


def pictures_of_run(result):
    """(name, Figure) of everything that a report.Result allows to draw, one after the other."""
    from vi_ekf_slam.evaluation import graphs, top_view
    subject, run = result.subject, result.subject.run
    name = top_view.plain(subject.name)
    slam = subject.poses[:, :3, 3]
    dead = subject.dead_reckoning[1][:, :3, 3] if subject.dead_reckoning else None
    truth, positions_only = None, result.slam and result.slam.positions_only
    if subject.truth is not None and not positions_only:
        truth = truth_line(subject.truth[0], anchor_truth(subject.truth, subject.stamps, subject.poses, subject.gauge))
    if result.slam:
        panels = list(zip(panel_titles(result.slam, result.dead_reckoning), _alignments(subject, truth)))
        yield ("trajectory", top_view.draw_alignments("%s, seen from above" % name, panels[1:] if positions_only else panels))
    else:
        yield ("trajectory", top_view.draw_run(name, slam, dead, truth, (), ()))
    if run and len(run.landmarks):
        note = "" if truth is None else ", the truth from a common start"
        figure = top_view.draw_run(name + ": landmarks from above" + note, slam, None, truth, run.landmarks,
                                   run.horizontal_deviations(), run.landmark_covariances)
        yield ("landmarks", figure)
    if result.consistency:
        what = ": pose of the IMU, error and 3-sigma bounds about the world's axes" if result.consistency.nees is not None else \
            ": pose of the IMU, 3-sigma bounds about the world's axes (no truth%s)" % (" of it" if positions_only else "")
        yield ("errors", graphs.draw_errors(name + what, result.consistency))
    if subject.frames:
        yield ("frames", graphs.draw_frames(name + ": stereo frames", subject.frames))
    if result.slam and not positions_only:
        judged = [("SLAM", result.slam)] + ([("smoothed", result.smoothed)] if result.smoothed else [])
        lines = graphs.drift_lines(result.dead_reckoning, judged, [False, True][:len(judged)])  # dashed: they nearly agree
        yield ("drift", graphs.draw_drift(
            "%s: drift of the %s from a common start" % (name, result.slam.body), lines))


def _alignments(subject, truth):
    """Lines of top_view.draw_alignments: from a common start, in which the truth is `truth` (N, 3) m, and aligned."""
    from vi_ekf_slam.evaluation import top_view
    estimates = [("dead reckoning", subject.dead_reckoning, top_view.DEAD_RECKONING_STYLE),
                 ("SLAM", (subject.stamps, subject.poses), top_view.SLAM_STYLE),
                 ("smoothed", subject.run and subject.run.smoothed, top_view.SMOOTHED_STYLE)]
    estimates = [line for line in estimates if line[1]]
    started = [(label, poses[:, :3, 3], style) for label, (_, poses), style in estimates]
    aligned = [(label, align(trajectory, subject.truth), style) for label, trajectory, style in estimates]
    return ([("truth", truth, top_view.TRUTH_STYLE)] + started,
            [("truth", truth_line(*subject.truth), top_view.TRUTH_STYLE)] + aligned)


def pictures_of_comparison(results):
    """(name, Figure) of all runs that overlap the first in time, laid onto its start; nothing if there is only one."""
    from vi_ekf_slam.evaluation import graphs, top_view
    first = results[0]
    alike = [r for r in results if meets(r.subject, first.subject)]
    if len(alike) < 2:
        return
    origin = (first.subject.stamps, first.subject.poses)
    lines = []
    truth = next((r.subject.truth for r in alike if r.slam and not r.slam.positions_only), None)
    if truth is not None:
        lines.append(("truth", truth_line(truth[0], anchor_truth(truth, *origin)), top_view.TRUTH_STYLE))
    dead = next((r for r in alike if r.subject.dead_reckoning), None)
    if dead is not None:
        lines.append(("dead reckoning", anchor_truth(dead.subject.dead_reckoning, *origin)[:, :3, 3],
                      top_view.DEAD_RECKONING_ON_TOP))
    repeats = _repeats(alike)
    for result, style in zip(alike, graphs.line_styles(len(alike), repeats)):
        subject = result.subject
        positions = anchor_truth((subject.stamps, subject.poses), *origin)[:, :3, 3]
        lines.append((top_view.plain(subject.name), positions, style))
    yield ("comparison", top_view.draw_trajectories("%d runs from a common start" % len(alike), lines))
    judged = [(repeat, r) for repeat, r in zip(repeats, alike) if r.slam and not r.slam.positions_only]
    if judged:
        dead = next((r.dead_reckoning for _, r in judged if r.dead_reckoning), None)
        yield ("comparison_drift", graphs.draw_drift(
            "drift of the %s from a common start" % " or ".join(sorted({r.slam.body for _, r in judged})),
            graphs.drift_lines(dead, [(top_view.plain(r.subject.name), r.slam) for _, r in judged],
                               [repeat for repeat, _ in judged])))


def _repeats(results):
    """Of each run whether one before it has the same poses: drawn dashed, both can be seen."""
    poses = [r.subject.poses for r in results]
    return [any(np.array_equal(p, earlier) for earlier in poses[:k]) for k, p in enumerate(poses)]


def save_pictures(pictures, folder):
    """Write (name, Figure) as folder/evaluation_NAME.png and .svg; yields the paths without suffix."""
    for name, figure in pictures:
        from vi_ekf_slam.evaluation import top_view
        box = top_view.tight_box(figure)
        for path in _paths(folder, name):
            check_output(path)
            with replacing(path) as stream:
                top_view.save(figure, stream, os.path.splitext(path)[1][1:], box=box)
        yield os.path.splitext(path)[0]


def remove_pictures(folder, names):
    """Of an earlier evaluation, which they would outlive: RUN_PICTURES or COMPARISON_PICTURES."""
    for path in (path for name in names for path in _paths(folder, name)):
        with contextlib.suppress(FileNotFoundError):
            os.remove(path)


def _paths(folder, name):
    return [os.path.join(folder, "evaluation_%s.%s" % (name, kind)) for kind in ("png", "svg")]
