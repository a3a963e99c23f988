"""What is to be judged: run directories or trajectory files, each with its bag and its truth."""

import os

import numpy as np

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse
from vi_ekf_slam.dataset.pose_files import read_pose_file
from vi_ekf_slam.dataset.truth import load_truth
from vi_ekf_slam.evaluation.gauge import gauge_of
from vi_ekf_slam.evaluation.run_io import read_covariances, read_frames, read_map_starts, read_run, read_summary


class Subject:
    """One trajectory to judge, and what is known beside it.

    name: for tables and pictures. source: path of the directory or file.
    stamps (N,) s, poses (N, 4, 4): world_T_imu in a world frame of its own.
    dead_reckoning: (stamps, poses) or None. run: run_io.Run or None where the source is a file.
    covariances, smoothed_covariances (N, 6, 6) of the poses and of run.smoothed, or None; frames: columns of frames.csv or None.
    gauge: of gauge.GAUGES. cam_T_imu: 4 x 4 or None. truth: (stamps, poses of the same body) in any world frame, or None.
    truth_body: of truth.BODIES, as the user said, or None.
    bag: path of its bag or None. map_starts: of run_io.read_map_starts.
    """

    def __init__(self, name, source, trajectory):
        self.name, self.source = name, source
        self.stamps, self.poses = trajectory
        self.gauge = "pose"
        self.dead_reckoning = self.run = self.covariances = self.frames = self.cam_T_imu = self.truth = self.bag = None
        self.smoothed_covariances = self.truth_body = None
        self.map_starts = []

    @property
    def summary(self):
        """Dict of summary.yaml; empty without one."""
        return self.run.summary if self.run else {}


def read_bag(path, body=None):
    """bag.reader.Reference of a bag, or None for no path. body: the IMU's frame, of body_of; None: that of its IMU."""
    if not path:
        return None
    from vi_ekf_slam.bag.reader import read_reference  # needs ROS, the rest does not
    return read_reference(path, body)


def body_of(path):
    """The frame whose poses a run directory holds, or None where that is not known."""
    return (os.path.isdir(path) and read_summary(os.path.join(path, "summary.yaml")).get("body")) or None


def find_truth(path, body, stamps, reference, gauge="pose"):
    """Truth as (stamps, IMU poses), from the file if there is one and else from the bag; None where neither has it.

    body: whose poses the file holds, see truth.load_truth. stamps (N,) s: those of the run, and of starts in whose map it may be. reference: of read_bag.
    gauge: of gauge.GAUGES; but for "pose" the file's world must have z upwards.
    """
    if not path:
        return reference.truth if reference else None
    return _load(path, body, reference, gauge, stamps)


def _load(path, body, reference, gauge, stamps=None):
    """load_truth of a pose file. stamps (N,) s: of the drive, where the file has its own; None: its own."""
    own = read_pose_file(path)[0]
    if own is None and reference is None:
        raise InputError("%s: is in KITTI's format, which has no stamps and holds poses of the left camera: --bag is "
                         "needed for both" % path)
    if own is None:
        stamps = reference.frame_stamps
    return load_truth(path, own if stamps is None else stamps, reference.cam_T_imu if reference else None, body,
                      anchored=gauge in (None, "pose"))


def of_body(truth, reference, summary):
    """(truth, cam_T_imu) of the body whose poses a run holds: those of a camera without an IMU are the left camera's own.

    truth: (stamps, IMU poses) or None. reference: of read_bag. summary: of read_run; one of before names no body.
    """
    cam_T_imu = reference.cam_T_imu if reference else None
    if cam_T_imu is None or not summary.get("body") or summary["body"] != reference.camera:
        return truth, cam_T_imu
    return truth and (truth[0], truth[1] @ inverse(cam_T_imu)), np.eye(4)


def extrinsic_to_compare(cam_T_imu, positions_only, truth_body):
    """cam_T_imu, 4 x 4 or None, for against_truth.evaluate: positions alone do not say where the other body is."""
    return None if positions_only and truth_body != "left_camera" else cam_T_imu


def read_subject(path, name, reference=None, body=None, gauge=None):
    """Read a run directory or a trajectory file, TUM or KITTI, without truth. reference: of read_bag.

    body: whose poses a file holds (truth.BODIES; None: the IMU's in TUM, the left camera's in KITTI). Row k of a KITTI
    file is frame k of the bag. gauge: of gauge.GAUGES; None: as the run's summary says.
    """
    if os.path.isdir(path):
        run = read_run(path)
        subject = Subject(name, path, (run.stamps, run.poses))
        subject.run, subject.dead_reckoning = run, (run.dead_stamps, run.dead_poses)
        subject.covariances = read_covariances(os.path.join(path, "covariance.csv"), run.stamps)
        if subject.covariances is not None:
            subject.map_starts = read_map_starts(path, run.summary, run.stamps, subject.covariances)
        if run.smoothed:
            subject.smoothed_covariances = read_covariances(os.path.join(path, "covariance_smoothed.csv"), run.smoothed[0])
        subject.frames = read_frames(os.path.join(path, "frames.csv"))
    else:
        subject = Subject(name, path, _load(path, body, reference, gauge))
    subject.cam_T_imu = reference.cam_T_imu if reference else None
    subject.gauge = gauge or gauge_of(subject.summary)
    return subject


def default_names(paths):
    """A short name for each path: its last part without .tum or .txt, or the whole path where that names several."""
    short = []
    for path in paths:
        base = os.path.basename(os.path.abspath(path))
        stem, suffix = os.path.splitext(base)
        short.append(stem if suffix in (".tum", ".txt") else base)
    return [name if short.count(name) == 1 else path for name, path in zip(short, paths)]


def meets(first, second):
    """Whether two Subjects overlap in time, so that they may be drawn in one picture."""
    return max(first.stamps[0], second.stamps[0]) <= min(first.stamps[-1], second.stamps[-1])
