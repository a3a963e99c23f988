"""The paper's nine figures: for each the drive, the estimators that are compared in it, and the two pictures."""

import io
from collections import namedtuple

import numpy as np

from vi_ekf_slam.evaluation.against_truth import anchor_truth, title_of_errors

# matplotlib is slow to load, so the functions that draw load it: inputs are complained about first.

DRIVES = ("0022", "0027", "0034")
SIDES = {"paper": "the paper's filter", "ours": "our filter"}
LONG_SIDE = 4.6  # inch; text keeps its size, so a small picture can still be read on a phone
MIN_ASPECT = 0.75  # of the view, so that the notes on it have room on a straight drive too
DPI = 180

Method = namedtuple("Method", "label config mode options")
Method.__doc__ = """A way to take a drive: its label, the configuration's name (below), and run_bag's further options.

config: "ours", or a file of its own that is the paper's configuration with paper.mode set to `mode`.
"""
METHODS = {
    "paper_dead_reckoning": Method("paper: dead reckoning", "paper_dead_reckoning", "dead_reckoning", ()),
    "paper_mapping": Method("paper: mapping", "paper_mapping", "mapping", ()),
    "paper_slam": Method("paper: SLAM", "paper_slam", "slam", ()),
    "ours_camera_off": Method("ours: camera off", "ours", None, ("--features", "")),
    "ours_slam": Method("ours: SLAM", "ours", None, ()),
}

Kind = namedtuple("Kind", "name caption methods explanation")
Kind.__doc__ = """Three figures in a row, one a drive. caption: the paper's; methods: one for each of SIDES."""
KINDS = (
    Kind("dead reckoning", "Trajectory for dataset%s", ("paper_dead_reckoning", "ours_camera_off"),
         "What the measured velocity and angular rate give without the camera. The paper's filter integrates them; "
         "ours takes them as measurements of a twist that changes slowly."),
    Kind("visual map", "Visual Map for dataset%s", ("paper_mapping", "ours_slam"),
         "The landmarks from above. The paper's filter maps a tenth of them along dead reckoning, which it takes as "
         "true; with its pixel noise of 7e4 px they stay where the first pair of images put them. Ours has no separate "
         "mapping: its landmarks are those of the SLAM run."),
    Kind("SLAM", "SLAM for dataset%s", ("paper_slam", "ours_slam"),
         "Trajectory and landmarks estimated together, beside dead reckoning. With its pixel noise the paper's camera "
         "has hardly any effect: its trajectory is that of dead reckoning."),
)

Figure = namedtuple("Figure", "number kind drive")


def figures_of(drives):
    """The Figures of the paper for those drives, in the order of their numbers."""
    return [Figure(len(DRIVES) * i + k + 1, kind, drive)
            for i, kind in enumerate(KINDS) for k, drive in enumerate(DRIVES) if drive in drives]


def picture_name(number, side):
    """Name of a picture's file, without suffix."""
    return "figure_%d_%s" % (number, side)


def draw_pair(figure, results):
    """The pictures of both SIDES in one view and one scale of colours. results: evaluation.report.Result of each."""
    from vi_ekf_slam.evaluation import top_view
    lines = [_lines(figure.kind, side, result) for side, result in zip(SIDES, results)]
    common = {"limits": top_view.view_limits([positions for side in lines for _, positions, _ in side], MIN_ASPECT),
              "colors": top_view.color_limits(np.concatenate([r.subject.run.horizontal_deviations() for r in results])),
              "long_side": LONG_SIDE}
    return [top_view.draw_trajectories(_title(figure, side, result), these, *_landmarks(figure.kind, result), **common)
            for side, result, these in zip(SIDES, results, lines)]


def _lines(kind, side, result):
    """Trajectories for top_view.draw_trajectories; the last is the one that the figure is about."""
    from vi_ekf_slam.evaluation import top_view
    subject, lines = result.subject, []
    if subject.truth is not None:
        truth = anchor_truth(subject.truth, subject.stamps, subject.poses)
        lines.append(("truth", truth[:, :3, 3], top_view.TRUTH_STYLE))
    if kind.name == "SLAM":
        lines.append(("dead reckoning", subject.dead_reckoning[1][:, :3, 3], top_view.DEAD_RECKONING_ON_TOP))
    label, style = "SLAM", top_view.SLAM_STYLE
    if kind.name == "dead reckoning" or (kind.name == "visual map" and side == "paper"):
        label = "dead reckoning" if side == "paper" else "camera off"
        style = dict(top_view.DEAD_RECKONING_ON_TOP, linewidth=2.0)
    return lines + [(label, subject.poses[:, :3, 3], style)]


def _landmarks(kind, result):
    run = result.subject.run
    if kind.name == "dead reckoning":
        return ()
    return run.landmarks, run.horizontal_deviations(), run.landmark_covariances if kind.name == "visual map" else None


def _title(figure, side, result):
    text = "Fig. %d, %s: %s, %s" % (figure.number, figure.drive, figure.kind.name, SIDES[side])
    if result.slam:
        text += "\n" + title_of_errors(result.slam, result.dead_reckoning if figure.kind.name == "SLAM" else None)
    return text


def to_bytes(picture, kind):
    """The file of a picture; kind: "png" or "svg"."""
    from vi_ekf_slam.evaluation import top_view
    stream = io.BytesIO()
    top_view.save(picture, stream, kind, DPI)
    return stream.getvalue()
