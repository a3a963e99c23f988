"""Compare an estimated trajectory with the truth."""

from collections import namedtuple

import numpy as np

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import so3_log
from vi_ekf_slam.dataset.truth import MAX_GAP, STAMP_TOLERANCE, sample_poses
from vi_ekf_slam.evaluation.consistency import nees, pose_errors
from vi_ekf_slam.evaluation.gauge import (covariances_of_frame, differences_of_up, errors_after_yaw_alignment, frame_change,
                                          most_certain)
from vi_ekf_slam.evaluation.metrics import (NO_RELATIVE_ERRORS, absolute_trajectory_error, anchored_errors, distances,
                                            kitti_segments, left_camera_poses, mean_kitti_errors, pairs_ahead,
                                            relative_pose_errors, rigid_alignment)

RPE_SECONDS, RPE_METRES = 1.0, 10.0
SPARSE = 1.5  # times the trajectory's step: between 1, equal rates whose stamps jitter, and 2, half the rate
LEAST_TURN = 0.1  # rad; less may be the error of an estimate of a body that truly never turns, as only simulated ones do

Evaluation = namedtuple("Evaluation", "ate kitti matched body anchored way distance error segments rpe "
                                      "ate_yaw orientation tilt truth_step sections covered positions_only")
Evaluation.__doc__ = """Errors of one trajectory.

ate: m, RMSE of the positions after rigid alignment. kitti: metrics.KittiErrors. matched: number M of poses compared.
body: whose positions, as text. anchored: m, RMSE of `error`. way: m, length of the true path.
distance, error (M,): m of true path up to each pose, and its position error in m when the first poses coincide.
segments: of metrics.kitti_segments. rpe: {"frame", "second", "metre": metrics.RelativeErrors} over one frame,
RPE_SECONDS and RPE_METRES of true path. ate_yaw m, orientation deg: RMSE over the IMU's poses after alignment by yaw and
position; tilt rad: median angle between what is upwards by both; all None where gravity says nothing.
truth_step: s between true poses where these are sparse, see match, or None.
sections (M,): of truth_sections; way, distance, segments and rpe leave out what spans a gap. covered: s within them.
positions_only: the truth has no orientations: error and anchored are nan, segments and rpe empty, orientation and tilt None.
"""

Match = namedtuple("Match", "stamps estimate truth rows")
Match.__doc__ = """Poses of both at the same stamps (M,) s: estimate, truth (M, 4, 4); rows (M,): the nearest pose of the estimate."""

Consistency = namedtuple("Consistency", "stamps errors deviations nees nees_position nees_rotation sections")
Consistency.__doc__ = """Pose errors of the IMU and what the covariance says of them, in the axes of the run's world.

stamps (M,) s. errors (M, 6): consistency.pose_errors, or None without truth. deviations (M, 6): square roots of the
covariances' diagonals, m and rad. nees (M,) of the pose (6 dof), position and rotation (3 dof each), or None.
sections (M,): of truth_sections, or None.
"""


def evaluate(stamps, poses, truth, cam_T_imu=None, gauge="pose", positions_only=False):
    """Errors of world_T_imu poses (N, 4, 4) at stamps (N,) s against truth = (stamps, IMU poses), in any world frame.

    With an extrinsic the left cameras are compared, as the KITTI benchmark does, else the IMUs. Compared are the poses of
    match. gauge: of gauge.GAUGES; with another than "pose" both worlds have z upwards. positions_only: the truth's
    orientations stand for nothing, see lacks_orientations, and its positions are those of what is compared.
    """
    matched, estimate, true_poses, _ = match(stamps, poses, truth)
    sections = truth_sections(truth[0], matched)
    yaw_errors = (None, None, None)
    if gauge != "pose":
        tilt = float(np.median(differences_of_up(estimate, true_poses)))
        yaw_errors = errors_after_yaw_alignment(estimate, true_poses) + (tilt,)
    body = "IMU"
    if cam_T_imu is not None:
        estimate, true_poses = (left_camera_poses(p, cam_T_imu) for p in (estimate, true_poses))
        body = "left camera"
    error, distance = anchored_errors(estimate, true_poses), distances(true_poses, sections)
    segments = kitti_segments(estimate, true_poses, sections=sections)
    frames = np.arange(len(estimate))
    rpe = {name: relative_pose_errors(estimate, true_poses, pairs_ahead(values, delta, sections))
           for name, values, delta in (("frame", frames, 1), ("second", matched, RPE_SECONDS),
                                       ("metre", distance, RPE_METRES))}
    if positions_only:
        error, segments, yaw_errors = np.full(len(error), np.nan), segments[:0], (yaw_errors[0], None, None)
        rpe = dict.fromkeys(rpe, NO_RELATIVE_ERRORS)
    return Evaluation(absolute_trajectory_error(estimate, true_poses), mean_kitti_errors(segments), len(estimate), body,
                      float(np.sqrt(np.mean(error**2))), float(distance[-1]), distance, error, segments, rpe,
                      *yaw_errors, _median_step(truth[0]) if _is_sparse(truth[0], stamps) else None, sections,
                      float(np.diff(matched)[np.diff(sections) == 0].sum()), positions_only)


def truth_sections(truth_stamps, stamps):
    """Numbers (N,), rising, of the stretches between gaps of the truth that the stamps (N,) s, which it reaches, are in.

    A gap is what is too long to interpolate, or one and a half steps of a truth that is sparser than that.
    """
    if len(truth_stamps) < 2:
        return np.zeros(len(stamps), dtype=int)
    is_gap = np.diff(truth_stamps) > max(MAX_GAP, SPARSE * _median_step(truth_stamps))
    return np.searchsorted(truth_stamps[1:][is_gap], stamps + STAMP_TOLERANCE, side="right")


def lacks_orientations(poses, truth_poses):
    """Whether a truth (M, 4, 4) has one orientation throughout, to the last digit, while the estimate (N, 4, 4) turns: it
    holds positions alone, as of GNSS or of a total station, in a format that asks for more."""
    rotations, true_rotations = poses[:, :3, :3], truth_poses[:, :3, :3]
    if len(truth_poses) < 2 or np.ptp(true_rotations, axis=0).max() > 1e-9:
        return False
    return bool(np.linalg.norm(so3_log(rotations[0].T @ rotations), axis=1).max() > LEAST_TURN)


def match(stamps, poses, truth):
    """The Match of an estimate and the truth, of two poses at least: at the estimate's stamps, as far as the truth reaches them.

    Where the truth is sparse it is at the truth's stamps: between poses a second apart a straight line is not the truth.
    """
    found = _pair(stamps, poses, truth)
    if len(found.stamps) < 2:  # one pose alone is right after any alignment
        raise InputError("the truth, %.3f to %.3f s, %s the trajectory, %.3f to %.3f s" % (
            truth[0][0], truth[0][-1], "shares one pose, of at least two that are needed, with" if len(found.stamps)
            else "does not meet", stamps[0], stamps[-1]))
    return found


def _pair(stamps, poses, truth):
    if _is_sparse(truth[0], stamps):
        valid, estimate = sample_poses(stamps, poses, truth[0])
        matched = truth[0][valid]
        after = np.clip(np.searchsorted(stamps, matched), 1, len(stamps) - 1)
        rows = np.where(matched - stamps[after - 1] < stamps[after] - matched, after - 1, after)
        return Match(matched, estimate, truth[1][valid], rows)
    valid, true_poses = sample_poses(*truth, stamps)
    return Match(stamps[valid], poses[valid], true_poses, np.flatnonzero(valid))


def _is_sparse(truth_stamps, stamps):
    return min(len(truth_stamps), len(stamps)) > 1 and _median_step(truth_stamps) > SPARSE * _median_step(stamps)


def _median_step(stamps):
    return float(np.median(np.diff(stamps)))


def judge_covariances(stamps, poses, covariances, truth=None, gauge="pose", map_starts=()):
    """Consistency of world_T_imu poses (N, 4, 4) with covariances (N, 6, 6) in the coordinates of covariance.csv.

    The truth is brought into the estimate's world by frame_of_truth. map_starts: of run_io.read_map_starts.
    """
    if truth is None:
        return Consistency(stamps, None, _deviations(covariances), None, None, None, None)
    found = match(stamps, poses, truth)
    world_T_truth, added = frame_of_truth(found, covariances[found.rows], truth, gauge, map_starts)
    matched, estimate, true_poses, rows = match(stamps, poses, (truth[0], world_T_truth @ truth[1]))
    errors, covariances = pose_errors(estimate, true_poses), covariances[rows] + added
    return Consistency(matched, errors, _deviations(covariances), nees(errors, covariances),
                       nees(errors[:, :3], covariances[:, :3, :3]), nees(errors[:, 3:], covariances[:, 3:, 3:]),
                       truth_sections(truth[0], matched))


def frame_of_truth(found, covariances, truth, gauge, map_starts=()):
    """(world_T_truth (4, 4), what the covariances (M, 6, 6) lack for errors in this frame, (M, 6, 6) or 0). found: of match.

    As far as the gauge is free, the truth is laid onto a pose m of the estimate, whose error e_m is then that of the frame:
    what is judged is e_k - A S e_m (gauge.covariances_of_frame). Which pose that is:

    - that with which the map began, where the run has been found in the map of an earlier start: there e_m is 0, and
      covariances are of e_k. Of several starts it is that by which the first pose's NEES is least.
    - else the most certain one. In a frame of its own an estimate learns nothing of where that is, so this is the first, at
      which e_m is 0, or what all later errors contain: the covariance of e_k stays an upper bound.
    - Where it is a later one, the estimate has learnt its place in a map that is not known here: A S P_m S A^T is added, as
      for independent errors. What e_k and e_m have in common makes the difference smaller: an honest NEES is 6 at most.
    """
    def lay(pair, row):
        return frame_change(pair.estimate[row], pair.truth[row], gauge)
    known = [_pair(*start, truth) for start in map_starts]
    frames = [lay(pair, 0) for pair, start in zip(known, map_starts) if len(pair.stamps) and pair.rows[0] == 0]
    if frames:
        first = [pose_errors(found.estimate[:1], frame @ found.truth[:1]) for frame in frames]
        return frames[int(np.argmin([nees(error, covariances[:1])[0] for error in first]))], 0.0
    row = most_certain(covariances, gauge)
    if row == 0:
        return lay(found, 0), 0.0
    return lay(found, row), covariances_of_frame(covariances[row], found.estimate[row], found.estimate, gauge)


def _deviations(covariances):
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    return np.sqrt(np.where(variances >= 0.0, variances, np.nan))


def anchor_truth(truth, stamps, poses, gauge="pose"):
    """Truth poses moved, by what the gauge leaves free, so that they agree with the estimate at the first stamp of both."""
    found = _pair(stamps, poses, truth)
    if not len(found.stamps):
        return truth[1]
    return frame_change(found.estimate[0], found.truth[0], gauge) @ truth[1]


def with_breaks(sections, values):
    """Rows (N, ...) with one of nan where a new section begins, across which no line is to be drawn; sections: None or (N,)."""
    breaks = [] if sections is None else np.flatnonzero(np.diff(sections)) + 1
    return np.insert(np.asarray(values, dtype=float), breaks, np.nan, axis=0)


def truth_line(stamps, poses):
    """Positions (N, 3) m of a truth to draw, interrupted by nan where it has gaps."""
    return with_breaks(truth_sections(stamps, stamps), poses[:, :3, 3])


def align(trajectory, truth):
    """Positions (N, 3) m of trajectory = (stamps (N,) s, poses (N, 4, 4)), rigidly aligned with those of the truth."""
    stamps, poses = trajectory
    _, estimate, true_poses, _ = match(stamps, poses, truth)
    truth_T_world = rigid_alignment(estimate[:, :3, 3], true_poses[:, :3, 3])
    return (truth_T_world @ poses)[:, :3, 3]


def describe(name, evaluation):
    """One line of text."""
    text = "%s: ATE %.3f m (%s, %d poses)" % (name, evaluation.ate, evaluation.body, evaluation.matched)
    if evaluation.positions_only:
        return text + ", the truth has positions alone"
    if evaluation.kitti.count == 0:
        return text + ", too short for sub-sequences of 100 m"
    return text + ", t_rel %.3f %%, r_rel %.3f deg/100 m (%d sub-sequences)" % (
        evaluation.kitti.t_rel, evaluation.kitti.r_rel, evaluation.kitti.count)


def title_of_errors(slam, dead_reckoning=None):
    """The lines under the title of a picture from a common start. Both are Evaluations."""
    ate = "ATE %s, of a rigid alignment that is not drawn" % _both(slam.ate, dead_reckoning and dead_reckoning.ate)
    if slam.positions_only:
        return ate
    return ate + ";\nfrom a common start, as drawn: wrong by %s at the end" % (
        _both(slam.error[-1], dead_reckoning and dead_reckoning.error[-1]))


def panel_titles(slam, dead_reckoning=None):
    """The titles of top_view.draw_alignments' panels. Both are Evaluations."""
    return ("from a common start; at the end wrong by\n%s" % _both(slam.error[-1],
                                                                  dead_reckoning and dead_reckoning.error[-1]),
            "rigidly aligned; ATE\n%s" % _both(slam.ate, dead_reckoning and dead_reckoning.ate))


def _both(slam, dead_reckoning):
    return _metres(slam) if dead_reckoning is None else "%s (dead reckoning %s)" % (_metres(slam), _metres(dead_reckoning))


def _metres(value):
    return "%.2f m" % value if value >= 0.995 else "%.0f mm" % (1e3 * value)
