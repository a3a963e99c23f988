"""Dead reckoning: the pose from body velocity and gyro alone, the yardstick of every estimator."""

import numpy as np

from vi_ekf_slam.common.geometry import se3_exp


def dead_reckon(stamps, linear_velocity, angular_velocity):
    """Integrate world_T_imu_{k+1} = world_T_imu_k Exp(dt [v_k; w_k]), the sample at k held until k + 1.

    stamps: (T,) s. linear_velocity, angular_velocity: (3, T), m/s and rad/s in IMU axes.
    Returns (T, 4, 4) poses world_T_imu; the first is the identity.
    """
    twist = np.vstack([linear_velocity, angular_velocity])
    poses = np.empty((len(stamps), 4, 4))
    poses[0] = np.eye(4)
    for k, dt in enumerate(np.diff(stamps)):
        poses[k + 1] = poses[k] @ se3_exp(dt * twist[:, k])
    return poses


def travelled_distance(stamps, linear_velocity):
    """Length in m of the path that the measured velocity (3, T) m/s implies."""
    return float(np.sum(np.diff(stamps) * np.linalg.norm(linear_velocity[:, :-1], axis=0)))
