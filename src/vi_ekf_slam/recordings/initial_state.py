"""A state that a run starts from, as a YAML file:

    stamp: 1521753106.733927488      # s, of the state
    position: [x, y, z]              # m, of the IMU in the map frame, z up
    orientation: [x, y, z, w]        # map_T_imu
    velocity: [x, y, z]              # m/s, along the map's axes
    gyro_bias: [x, y, z]             # rad/s
    accelerometer_bias: [x, y, z]    # m/s^2
    covariance: [225 numbers]        # 15 x 15, row by row

The covariance is that of (position, rotation, velocity, gyro bias, accelerometer bias): each the truth minus the
estimate, the rotation about the map's axes, R = Exp(error) R_estimated.
"""

import numpy as np

from vi_ekf_slam.common.geometry import rotation_to_quaternion
from vi_ekf_slam.common.yaml_file import yaml_number

BLOCKS = tuple(slice(3 * k, 3 * k + 3) for k in range(5))


def covariance_about_map(covariance, rotation):
    """From a covariance of (rotation, position, velocity, biases) with the rotation's error in IMU axes to the file's.

    covariance (15, 15): of the errors estimate minus truth, R_estimated = R Exp(error). rotation: R_estimated, map_R_imu.
    Then R = R_estimated Exp(-error) = Exp(-R_estimated error) R_estimated; the sign is that of all other errors.
    """
    new_from_old = np.zeros((15, 15))
    new_from_old[BLOCKS[0], BLOCKS[1]] = np.eye(3)
    new_from_old[BLOCKS[1], BLOCKS[0]] = rotation
    new_from_old[6:, 6:] = np.eye(9)
    result = new_from_old @ covariance @ new_from_old.T
    return 0.5 * (result + result.T)


def to_yaml(state):
    """Text of the file. state: recording.InitialState."""
    rows = [("position", state.world_T_imu[:3, 3], "m, of the IMU in the map frame, z up"),
            ("orientation", rotation_to_quaternion(state.world_T_imu[:3, :3]), "x y z w of map_T_imu"),
            ("velocity", state.velocity, "m/s, along the map's axes"), ("gyro_bias", state.gyro_bias, "rad/s"),
            ("accelerometer_bias", state.accelerometer_bias, "m/s^2")]
    lines = ["stamp: %d.%09d  # s" % divmod(state.stamp, 10**9)]
    lines += ["%s: [%s]  # %s" % (key, ", ".join(map(yaml_number, values)), unit) for key, values, unit in rows]
    lines.append("# of (position, rotation, velocity, gyro bias, accelerometer bias), truth minus estimate; the rotation\n"
                 "# about the map's axes, R = Exp(error) R_estimated; 15 x 15, row by row")
    matrix = ",\n  ".join(", ".join(map(yaml_number, row)) for row in state.covariance)
    return "\n".join(lines) + "\ncovariance: [\n  %s]\n" % matrix
