"""The numbers of an evaluation: as plain data for evaluation.json and as a table for the terminal."""

from collections import namedtuple

import numpy as np

from vi_ekf_slam.evaluation.against_truth import RPE_METRES, RPE_SECONDS
from vi_ekf_slam.evaluation.consistency import chi_square_bounds
from vi_ekf_slam.evaluation.metrics import mean_kitti_errors
from vi_ekf_slam.evaluation.run_io import FRAME_TIME

Result = namedtuple("Result", "subject slam dead_reckoning consistency smoothed smoothed_consistency")
Result.__doc__ = """subject: run_inputs.Subject. slam, dead_reckoning, smoothed: against_truth.Evaluation or None.
consistency, smoothed_consistency: against_truth.Consistency or None."""

DRIFT_POINTS = 21  # places along the path at which evaluation.json states the position error

DEFINITIONS = {
    "ate": "m: RMSE of the positions after rigid alignment (Umeyama, no scale) over all matched poses",
    "ate_yaw_aligned, orientation": "m, deg: RMSE of the IMU's positions and orientations after alignment by yaw and "
                                    "position over all matched poses, where gravity fixes roll and pitch",
    "ate_anchored": "m: RMSE of the positions when the first matched poses coincide, rotation and all",
    "end_error": "m, and % of the true path, where that has no gap: the anchored position error of the last matched pose",
    "t_rel, r_rel": "%, deg/100 m: KITTI's errors over sub-sequences of 100 to 800 m from every 10th frame",
    "true_path": "m: without what lies in gaps of the truth; t_rel, r_rel and rpe leave out what spans one",
    "rpe": "m, deg: RMSE of inv(inv(Q_i) Q_j) inv(P_i) P_j (truth Q, estimate P) over all i; j is the next frame, "
           "the first at least %g s later, the first at least %g m of true path later" % (RPE_SECONDS, RPE_METRES),
    "smoothed": "trajectory_smoothed.tum: the same moments as they are known at the end of the run",
    "pose_nees": "of the IMU's pose: error (p^ - p, Log(R^ R^T)) about the world's axes with covariance.csv; mean over the "
                 "poses, 6 is right (3 for position or rotation alone). As far as the gauge is free the truth is laid onto "
                 "the first matched pose; of a run that was found in the map of an earlier start (before_reset_N), onto that "
                 "start's; in a map of which no start is known, onto the most certain pose, whose covariance, carried to each "
                 "other pose, is added there: 6 is then the most that is right",
    "gauge": "what of the world frame the estimate chose: pose (all of it), yaw (heading and position) or none (it was given "
             "a state in the truth's frame)",
    "within_bounds": "%: poses whose NEES lies within the 95 % bounds of a chi-square variable",
    "nis_per_dof": "sum of the frames' normalised innovation squared by that of their degrees of freedom; 1 is right",
    "frame_time": "ms of wall time that the estimator took for a frame",
}


def to_data(result):
    """A Result as plain dicts, lists and numbers; what is not known is missing or None."""
    subject = result.subject
    return {
        "name": subject.name,
        "source": subject.source,
        "poses": len(subject.stamps),
        "gauge": subject.gauge,
        "duration_s": float(subject.stamps[-1] - subject.stamps[0]),
        "slam": _errors(result.slam),
        "dead_reckoning": _errors(result.dead_reckoning),
        "smoothed": _errors(result.smoothed),
        "consistency": _consistency(result.consistency),
        "smoothed_consistency": _consistency(result.smoothed_consistency),
        "frames": _frames(subject.frames),
        "timing": _timing(subject.frames, subject.summary),
    }


def _errors(evaluation):
    if evaluation is None:
        return None
    e, lengths = evaluation, sorted(set(evaluation.segments[:, 0]))
    by_length = [mean_kitti_errors(e.segments[e.segments[:, 0] == length]) for length in lengths]
    places = np.searchsorted(e.distance, np.linspace(0.0, e.way, DRIFT_POINTS)[:-1])
    places = np.unique(np.append(places, e.matched - 1))
    return _plain({
        "body": e.body, "matched": e.matched, "true_path_m": e.way,
        "ate_m": e.ate, "ate_yaw_aligned_m": e.ate_yaw, "orientation_deg": e.orientation, "ate_anchored_m": e.anchored,
        "end_error_m": e.error[-1],
        "end_error_percent": 100.0 * e.error[-1] / e.way if e.way > 0.0 and not e.sections[-1] else None,
        "t_rel_percent": e.kitti.t_rel, "r_rel_deg_per_100m": e.kitti.r_rel, "sub_sequences": e.kitti.count,
        "rpe": {name: {"translation_m": r.translation, "rotation_deg": r.rotation, "pairs": r.count}
                for name, r in (("1 frame", e.rpe["frame"]), ("%g s" % RPE_SECONDS, e.rpe["second"]),
                                ("%g m" % RPE_METRES, e.rpe["metre"]))},
        "drift": {
            "sub_sequences": [{"length_m": length, "t_rel_percent": k.t_rel, "r_rel_deg_per_100m": k.r_rel,
                               "count": k.count} for length, k in zip(lengths, by_length)],
            "position_error": [{"distance_m": e.distance[k], "error_m": e.error[k]} for k in places],
        },
    })


def _consistency(consistency):
    if consistency is None or consistency.nees is None:
        return None
    low, high = chi_square_bounds(6)
    known = consistency.nees[np.isfinite(consistency.nees)]
    inside = 100.0 * np.mean((known >= low) & (known <= high)) if len(known) else None
    return _plain({"pose_nees": _mean(consistency.nees), "position_nees": _mean(consistency.nees_position),
                   "rotation_nees": _mean(consistency.nees_rotation), "within_bounds_percent": inside,
                   "bounds_95": [low, high], "poses": len(known)})


def _frames(frames):
    if frames is None:
        return None
    dof = frames["nis_dof"].sum()
    return _plain({
        "count": len(frames["stamp"]), "features_a_frame": _mean(frames["features"]),
        "used_a_frame": _mean(frames["used"]), "rejected_a_frame": _mean(frames["rejected"]),
        "frames_rejected": int(frames["frame_rejected"].sum()),
        "nis_per_dof": frames["nis"].sum() / dof if dof > 0.0 else None,
    })


def _timing(frames, summary):
    timing = {key: summary[key] for key in ("wall_s", "sensor_s", "times_real_time") if key in summary}
    if frames is not None and FRAME_TIME in frames:
        times = frames[FRAME_TIME]
        timing.update({"frame_mean_ms": times.mean(), "frame_median_ms": np.median(times),
                       "frame_95_percent_ms": np.percentile(times, 95.0), "frame_longest_ms": times.max()})
    return _plain(timing)


def _mean(values):
    known = values[np.isfinite(values)]
    return known.mean() if len(known) else None


def _plain(value):
    """Numpy's numbers as Python's, and nan, which JSON has no word for, as None."""
    if isinstance(value, dict):
        return {key: _plain(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (np.floating, float)):
        return float(value) if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


# Rows of the table: text, unit, format, then the keys to the number. Keys that begin with `both` are in "slam" and in
# "dead_reckoning" alike.
ROWS = (
    ("poses compared", "", "%d", ("both", "matched")),
    ("true path", "m", "%.1f", ("both", "true_path_m")),
    ("ATE, aligned", "m", "%.3f", ("both", "ate_m")),
    ("ATE, yaw-aligned, IMU", "m", "%.4f", ("both", "ate_yaw_aligned_m")),
    ("orientation, yaw-aligned", "deg", "%.3f", ("both", "orientation_deg")),
    ("ATE, anchored at the start", "m", "%.3f", ("both", "ate_anchored_m")),
    ("error at the end", "m", "%.3f", ("both", "end_error_m")),
    ("", "%", "%.2f", ("both", "end_error_percent")),
    ("t_rel, 100 to 800 m", "%", "%.2f", ("both", "t_rel_percent")),
    ("r_rel, 100 to 800 m", "deg/100 m", "%.2f", ("both", "r_rel_deg_per_100m")),
) + tuple((text, unit, "%.4f", ("both", "rpe", name, key))
          for name in ("1 frame", "%g s" % RPE_SECONDS, "%g m" % RPE_METRES)
          for text, unit, key in (("RPE over " + name, "m", "translation_m"), ("", "deg", "rotation_deg"))) + (
    ("pose NEES, 6 is right", "", "%.2f", ("consistency", "pose_nees")),
    ("position NEES, 3 is right", "", "%.2f", ("consistency", "position_nees")),
    ("rotation NEES, 3 is right", "", "%.2f", ("consistency", "rotation_nees")),
    ("NEES within 95 % bounds", "% of poses", "%.1f", ("consistency", "within_bounds_percent")),
    ("NIS per dof, 1 is right", "", "%.3f", ("frames", "nis_per_dof")),
    ("features used", "a frame", "%.1f", ("frames", "used_a_frame")),
    ("features rejected", "a frame", "%.1f", ("frames", "rejected_a_frame")),
    ("frames rejected", "", "%d", ("frames", "frames_rejected")),
    ("frame time, median", "ms", "%.2f", ("timing", "frame_median_ms")),
    ("frame time, 95 %", "ms", "%.2f", ("timing", "frame_95_percent_ms")),
    ("frame time, longest", "ms", "%.2f", ("timing", "frame_longest_ms")),
    ("times real time", "", "%.1f", ("timing", "times_real_time")),
)


def _lookup(data, keys):
    for key in keys:
        data = data.get(key) if isinstance(data, dict) else None
    return data


def cell(data, row, trajectory="slam"):
    """Text of one number of to_data, "-" where it is not known. row: of ROWS; trajectory: slam, dead_reckoning, smoothed."""
    _, _, pattern, keys = row
    if keys[0] == "both":
        value = _lookup(data, (trajectory,) + keys[1:])
    elif trajectory == "smoothed" and keys[0] == "consistency":
        value = _lookup(data, ("smoothed_consistency",) + keys[1:])
    else:
        value = _lookup(data, keys) if trajectory == "slam" else None
    return "-" if value is None else pattern % value


def table(runs):
    """Lines of text; runs: list of to_data's. A column for each trajectory, dead reckoning before SLAM.

    Runs of one drive have one dead reckoning, which gets one column.
    """
    columns = []
    for k, data in enumerate(runs):
        known = [earlier["dead_reckoning"] for earlier in runs[:k]]
        if data["dead_reckoning"] is not None and data["dead_reckoning"] not in known:
            columns.append((data, "dead_reckoning", "dead reckoning"))
        columns.append((data, "slam", "SLAM" if data["dead_reckoning"] is not None or data["frames"] else "trajectory"))
        if data.get("smoothed") is not None:
            columns.append((data, "smoothed", "smoothed"))
    cells = []
    for row in ROWS:
        texts = [cell(data, row, key) for data, key, _ in columns]
        if any(text != "-" for text in texts):
            cells.append(["%-27s%-11s" % row[:2]] + texts)
    header = [["run"] + [data["name"] for data, _, _ in columns], [""] + [name for _, _, name in columns]]
    bodies = {data[key]["body"] for data, key, _ in columns if data[key]}
    if bodies:
        header[1][0] = "positions of the " + " or ".join(sorted(bodies))
    rows = header + cells
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = ["  ".join([row[0].ljust(widths[0])] + [text.rjust(width) for text, width in zip(row[1:], widths[1:])])
             for row in rows]
    return lines[:2] + ["-" * max(map(len, lines))] + lines[2:]
