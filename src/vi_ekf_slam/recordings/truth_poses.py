"""True poses of a recorded drive, in a map whose z is upwards and that begins with the heading and position zero."""

import numpy as np

from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse, make_transform
from vi_ekf_slam.dataset.pose_files import quaternions_to_poses, read_pose_file
from vi_ekf_slam.evaluation.gauge import frame_change
from vi_ekf_slam.recordings.csv_table import read_table


def within(stamps, poses, start, end, path):
    """(stamps, map_T_imu) of world_T_imu poses from `start` to `end` ns; None when there is none.

    path: of the file where the user gave one, which is refused then; else None.
    """
    inside = (stamps >= start) & (stamps <= end)
    if not inside.any():
        if path:
            raise InputError("%s: none of its stamps is within the drive's time" % path)
        return None
    stamps, poses = stamps[inside], poses[inside]
    return stamps, frame_change(np.eye(4), poses[0], "yaw") @ poses


def asl_truth(path, faults):
    """(stamps ns, world_T_imu) of a data.csv: stamp, position, quaternion w x y z, and more that is not read.

    faults: of csv_table.read_table.
    """
    stamps, values = read_table(path, 7, faults)
    return stamps, quaternions_to_poses(values[:, [4, 5, 6, 3]], values[:, :3], lambda k: "%s: pose %d" % (path, k))


def file_truth(path, body, frame_stamps, imu_T_cam, upright, faults):
    """(stamps ns, world_T_imu) of a pose file, TUM (whose world has z upwards) or KITTI.

    Row k of a KITTI file is the left camera at frame k, in the axes of its first pose; surplus rows are added to `faults`.
    frame_stamps: (T,) ns, or None where they are not those of all frames. imu_T_cam 4 x 4. upright (3, 3): the first IMU pose
    in a world with z upwards, for KITTI files.
    """
    stamps, poses = read_pose_file(path)
    is_kitti = stamps is None
    if is_kitti:
        if frame_stamps is None:
            raise InputError("%s: is in KITTI's format, whose rows are counted by frames, of which some are left out, allowed: a "
                             "TUM file" % path)
        if len(poses) > len(frame_stamps):
            faults.add("%s: has %d rows, the drive %d frames" % (path, len(poses), len(frame_stamps)))
        poses = poses[:len(frame_stamps)]
        stamps = frame_stamps[:len(poses)]
    else:
        stamps = checks.nanoseconds(stamps)
    if body == "left_camera" or (body is None and is_kitti):
        poses = poses @ inverse(imu_T_cam)
    if is_kitti:
        poses = make_transform(upright, np.zeros(3)) @ inverse(poses[0]) @ poses
    return stamps, poses
