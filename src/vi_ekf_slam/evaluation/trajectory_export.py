"""Write the trajectories of a run in the formats that other tools read."""

import os

from vi_ekf_slam.common.output_file import make_directory, write_text
from vi_ekf_slam.dataset.pose_files import kitti_line, tum_line
from vi_ekf_slam.evaluation.against_truth import anchor_truth, match
from vi_ekf_slam.evaluation.metrics import left_camera_poses


def export(subject, folder, tum=True, kitti=False):
    """Write slam, dead_reckoning and truth, as far as they are known, into a folder; returns the paths.

    subject: run_inputs.Subject. tum: NAME.tum, poses of the IMU with stamps, the truth laid onto the estimate's start.
    kitti: NAME_kitti.txt, poses of the left camera in its first frame. Where there is truth these are the poses that
    are compared with it, in every file, because rows of that format have no stamps and are compared one by one.
    """
    trajectories = {"slam": (subject.stamps, subject.poses)}
    if subject.dead_reckoning:
        trajectories["dead_reckoning"] = subject.dead_reckoning
    if subject.truth is not None:
        trajectories["truth"] = (subject.truth[0], anchor_truth(subject.truth, subject.stamps, subject.poses, subject.gauge))
    paths = []
    if tum or kitti:
        make_directory(folder)
    for name, (stamps, poses) in trajectories.items():
        if tum:
            paths.append(os.path.join(folder, name + ".tum"))
            write_text(paths[-1], "".join(tum_line(stamp, pose) + "\n" for stamp, pose in zip(stamps, poses)))
        if kitti:
            if name == "truth":
                poses = match(subject.stamps, subject.poses, subject.truth).truth
            elif subject.truth is not None:
                poses = match(stamps, poses, subject.truth).estimate
            paths.append(os.path.join(folder, name + "_kitti.txt"))
            write_text(paths[-1], "".join(kitti_line(pose) + "\n"
                                          for pose in left_camera_poses(poses, subject.cam_T_imu)))
    return paths
