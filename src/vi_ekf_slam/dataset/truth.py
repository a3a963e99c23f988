"""Ground truth: from a pose file to IMU poses that begin at the identity, and onto the stamps of an estimate."""

import numpy as np

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse, so3_exp, so3_log
from vi_ekf_slam.dataset.pose_files import read_pose_file

BODIES = ("imu", "left_camera")
STAMP_TOLERANCE = 1e-4  # s; text files may round stamps, frames are at least milliseconds apart
MAX_GAP = 1.5  # s between two poses, which may come once a second; across longer gaps nothing is interpolated


def load_truth(path, frame_stamps, cam_T_imu, body=None, anchored=True):
    """Read a KITTI or TUM file as IMU poses.

    frame_stamps: (T,) s; row k of a KITTI file belongs to frame k, and there may be fewer rows than frames.
    cam_T_imu: 4 x 4, needed when the poses are the left camera's. body: "imu", "left_camera" or None, which stands for
    the left camera in KITTI files and for the IMU in TUM files. TUM poses outside the drive's time are left out.
    Returns (stamps (N,), imu0_T_imu (N, 4, 4)); the first pose is the identity:
    imu0_T_imu_k = imu_T_cam cam0_T_cam_k cam_T_imu. With anchored=False they stay in the file's world, whose z is upwards
    in TUM files; InputError for KITTI's, which have the first camera's axes.
    """
    stamps, poses = read_pose_file(path)
    if stamps is None and not anchored:
        raise InputError("%s: is in KITTI's format, which does not say where upwards is, allowed: a TUM file, none with a bag "
                         "that holds the truth, or with evaluate.py --gauge pose, which aligns the tilt away too" % path)
    if body is None:
        body = "left_camera" if stamps is None else "imu"
    if stamps is None:
        if len(poses) > len(frame_stamps):
            raise InputError("%s: has %d rows, allowed: at most the %d frames of the drive" % (path, len(poses), len(frame_stamps)))
        stamps = frame_stamps[:len(poses)]
    else:
        inside = (stamps >= frame_stamps[0] - STAMP_TOLERANCE) & (stamps <= frame_stamps[-1] + STAMP_TOLERANCE)
        if not inside.any():
            raise InputError("%s: its stamps, %.3f to %.3f s, do not meet the drive's, %.3f to %.3f s"
                             % (path, stamps[0], stamps[-1], frame_stamps[0], frame_stamps[-1]))
        stamps, poses = np.clip(stamps[inside], frame_stamps[0], frame_stamps[-1]), poses[inside]
    if body == "left_camera":
        if cam_T_imu is None:
            raise InputError("%s: holds poses of the left camera, and the drive has no extrinsic to the IMU" % path)
        poses = poses @ cam_T_imu
    return stamps, inverse(poses[0]) @ poses if anchored else poses


def sample_poses(stamps, poses, query):
    """Poses at the stamps `query` (Q,), between neighbours at most MAX_GAP apart on a straight line, at a constant rate of turn.

    Returns (valid, sampled): valid (Q,) bool tells which stamps the poses reach; sampled (valid.sum(), 4, 4).
    """
    after = np.minimum(np.searchsorted(stamps, query), len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(query - stamps[before] <= stamps[after] - query, before, after)
    known = np.abs(stamps[nearest] - query) <= STAMP_TOLERANCE
    step = stamps[after] - stamps[before]
    between = ~known & (stamps[before] < query) & (query < stamps[after]) & (step <= MAX_GAP)
    sampled = poses[nearest]
    if between.any():
        first, second = poses[before[between]], poses[after[between]]
        share = ((query - stamps[before])[between] / step[between])[:, None]
        turn = so3_log(np.swapaxes(first[:, :3, :3], 1, 2) @ second[:, :3, :3])
        sampled[between, :3, :3] = first[:, :3, :3] @ so3_exp(share * turn)
        sampled[between, :3, 3] = (1.0 - share) * first[:, :3, 3] + share * second[:, :3, 3]
    valid = known | between
    return valid, sampled[valid]
