"""Compare an estimated trajectory with the truth."""

from collections import namedtuple

from vi_ekf_slam.errors import InputError
from vi_ekf_slam.geometry import inverse
from vi_ekf_slam.metrics import absolute_trajectory_error, kitti_errors, left_camera_poses
from vi_ekf_slam.truth import sample_poses

Evaluation = namedtuple("Evaluation", "ate kitti matched body")
Evaluation.__doc__ = """ate: m. kitti: metrics.KittiErrors. matched: number of poses compared. body: whose positions, as text."""


def evaluate(stamps, poses, truth, cam_T_imu=None):
    """Errors of world_T_imu poses (N, 4, 4) at stamps (N,) s against truth = (stamps, IMU poses), in any world frame.

    With an extrinsic the left cameras are compared, as the KITTI benchmark does, else the IMUs. Poses whose stamps the
    truth does not reach are left out.
    """
    valid, true_poses = sample_poses(*truth, stamps)
    if not valid.any():
        raise InputError("the truth, %.3f to %.3f s, does not meet the trajectory, %.3f to %.3f s"
                         % (truth[0][0], truth[0][-1], stamps[0], stamps[-1]))
    estimate, body = poses[valid], "IMU"
    if cam_T_imu is not None:
        estimate, true_poses = (left_camera_poses(p, cam_T_imu) for p in (estimate, true_poses))
        body = "left camera"
    return Evaluation(absolute_trajectory_error(estimate, true_poses), kitti_errors(estimate, true_poses), len(estimate),
                      body)


def anchor_truth(truth, stamps, poses):
    """Truth poses moved rigidly so that they agree with the estimate at the first stamp that both have."""
    valid, sampled = sample_poses(*truth, stamps)
    if not valid.any():
        return truth[1]
    return poses[valid][0] @ inverse(sampled[0]) @ truth[1]


def describe(name, evaluation):
    """One line of text."""
    text = "%s: ATE %.3f m (%s, %d poses)" % (name, evaluation.ate, evaluation.body, evaluation.matched)
    if evaluation.kitti.count == 0:
        return text + ", too short for sub-sequences of 100 m"
    return text + ", t_rel %.3f %%, r_rel %.3f deg/100 m (%d sub-sequences)" % (
        evaluation.kitti.t_rel, evaluation.kitti.r_rel, evaluation.kitti.count)
