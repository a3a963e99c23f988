"""The ROS messages of a converted drive, one function a message. SI units; frames as in REP 103."""

import genpy
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, TransformStamped, TwistWithCovarianceStamped, Vector3
from nav_msgs.msg import Path
from sensor_msgs.msg import CameraInfo, CompressedImage, Imu
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from vi_ekf_slam.common.geometry import rotation_to_quaternion
from vi_ekf_slam.msg import StereoFeature, StereoFeatureArray

IMU_FRAME = "imu_link"
LEFT_FRAME = "left_camera_optical"
RIGHT_FRAME = "right_camera_optical"
TRUTH_FRAME = "map"

# (rad/s)^2. The velocity message has no field for "not measured"; this is a standard deviation of 1000 rad/s, with
# which a reader that fuses the whole twist learns nothing from the angular zeros.
UNKNOWN_VARIANCE = 1e6


def ros_time(stamp):
    """Integer nanoseconds -> genpy.Time."""
    return genpy.Time(*divmod(int(stamp), 1000000000))


def header(stamp, frame_id, seq=0):
    """Header; stamp: genpy.Time, as for all functions below."""
    return Header(seq=seq, stamp=stamp, frame_id=frame_id)


def imu(stamp, angular_velocity, gyro_variance, acceleration=None, accelerometer_variance=0.0, seq=0):
    """Sample of gyro (3, rad/s) and accelerometer (3, m/s^2; None: there is none); variances of one coordinate, 0: not known.

    -1 marks what the message does not carry (see Imu.msg).
    """
    message = Imu(header=header(stamp, IMU_FRAME, seq), angular_velocity=Vector3(*angular_velocity))
    message.angular_velocity_covariance = _diagonal([gyro_variance] * 3)
    message.orientation_covariance[0] = message.linear_acceleration_covariance[0] = -1.0
    if acceleration is not None:
        message.linear_acceleration = Vector3(*acceleration)
        message.linear_acceleration_covariance = _diagonal([accelerometer_variance] * 3)
    return message


def velocity(stamp, linear_velocity, sigma, seq=0):
    """Body velocity (3, m/s); sigma is its standard deviation. The angular block is marked by UNKNOWN_VARIANCE."""
    message = TwistWithCovarianceStamped(header=header(stamp, IMU_FRAME, seq))
    message.twist.twist.linear = Vector3(*linear_velocity)
    message.twist.covariance = _diagonal([sigma**2] * 3 + [UNKNOWN_VARIANCE] * 3)
    return message


def twist_bias(stamp, velocity_sigma, gyro_sigma):
    """What is known beforehand of the biases of velocity (m/s) and gyro (rad/s): zero, with these standard deviations."""
    message = TwistWithCovarianceStamped(header=header(stamp, IMU_FRAME))
    message.twist.covariance = _diagonal([velocity_sigma**2] * 3 + [gyro_sigma**2] * 3)
    return message


def stereo_features(stamp, ids, pixels, sigmas, seq=0):
    """Features of one frame. ids: N integers; pixels: N rows uL vL uR vR; sigmas: N, px, 0: not known."""
    features = [StereoFeature(int(i), *row, sigma, 0.0, b"") for i, row, sigma in zip(ids, pixels, sigmas)]
    return StereoFeatureArray(header=header(stamp, LEFT_FRAME, seq), features=features)


def camera_info(stamp, frame_id, camera, seq=0):
    """CameraInfo of a recordings.recording.Camera."""
    return CameraInfo(header=header(stamp, frame_id, seq), width=camera.size[0], height=camera.size[1],
                      distortion_model=camera.model, D=list(camera.distortion), K=camera.intrinsics.ravel().tolist(),
                      R=camera.rectification.ravel().tolist(), P=camera.projection.ravel().tolist())


def compressed_image(stamp, frame_id, data, encoding, seq=0):
    """The bytes of an image file as they are; encoding: "png" or "jpeg"."""
    return CompressedImage(header=header(stamp, frame_id, seq), format=encoding, data=data)


def rig_transforms(stamp, imu_T_left, left_T_right, imu_frame=IMU_FRAME, left_frame=LEFT_FRAME, right_frame=RIGHT_FRAME):
    """IMU -> left camera -> right camera, the latter unless left_T_right is None. A TF child's pose is parent_T_child."""
    transforms = [_transform(stamp, imu_frame, left_frame, imu_T_left)]
    if left_T_right is not None:
        transforms.append(_transform(stamp, left_frame, right_frame, left_T_right))
    return TFMessage(transforms)


def truth_pose(stamp, pose, seq=0):
    """Pose of the IMU (4 x 4) in the frame `map`."""
    quaternion = rotation_to_quaternion(pose[:3, :3])
    return PoseStamped(header(stamp, TRUTH_FRAME, seq), Pose(Point(*pose[:3, 3]), Quaternion(*quaternion)))


def truth_path(stamps, poses):
    """All truth poses as one path."""
    return Path(header(stamps[0], TRUTH_FRAME), [truth_pose(stamp, pose) for stamp, pose in zip(stamps, poses)])


def _transform(stamp, parent, child, parent_T_child):
    message = TransformStamped(header=header(stamp, parent), child_frame_id=child)
    message.transform.translation = Vector3(*parent_T_child[:3, 3])
    message.transform.rotation = Quaternion(*rotation_to_quaternion(parent_T_child[:3, :3]))
    return message


def _diagonal(variances):
    matrix = [0.0] * len(variances)**2
    matrix[::len(variances) + 1] = [float(variance) for variance in variances]
    return matrix
