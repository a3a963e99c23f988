"""The ROS messages of a converted drive, one function a message. SI units; frames as in REP 103."""

import genpy
import numpy as np
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, TransformStamped, TwistWithCovarianceStamped, Vector3
from nav_msgs.msg import Path
from sensor_msgs.msg import CameraInfo, CompressedImage, Imu
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from vi_ekf_slam.common.checks import nanoseconds
from vi_ekf_slam.common.geometry import inverse, make_transform, rotation_to_quaternion
from vi_ekf_slam.msg import StereoFeature, StereoFeatureArray

IMU_FRAME = "imu_link"
LEFT_FRAME = "left_camera_optical"
RIGHT_FRAME = "right_camera_optical"
TRUTH_FRAME = "map"

# (rad/s)^2. The velocity message has no field for "not measured"; this is a standard deviation of 1000 rad/s, with
# which a reader that fuses the whole twist learns nothing from the angular zeros.
UNKNOWN_VARIANCE = 1e6

# Rectified image sizes of the KITTI raw recordings by focal length in px: the files carry K but no image size.
KITTI_SIZES = {721.5377: (1242, 375), 707.0493: (1224, 370), 718.3351: (1238, 374), 707.0912: (1226, 370),
               718.856: (1241, 376)}


def ros_time(stamp):
    """Seconds -> genpy.Time, rounded to the nanosecond; a genpy.Time is itself."""
    return stamp if isinstance(stamp, genpy.Time) else from_nanoseconds(nanoseconds(np.float64(stamp)))


def from_nanoseconds(stamp):
    """Integer nanoseconds -> genpy.Time."""
    return genpy.Time(*divmod(int(stamp), 1000000000))


def header(stamp, frame_id, seq=0):
    """Header; stamp: seconds or a genpy.Time, as for all functions below."""
    return Header(seq=seq, stamp=ros_time(stamp), frame_id=frame_id)


def image_size(intrinsics, features, seen):
    """(width, height) in px: KITTI's where the focal length is one of KITTI's, else guessed from the principal point.

    Grown where needed so that every seen pixel (u, v) has u < width and v < height.
    """
    guess = (int(round(2.0 * intrinsics[0, 2])), int(round(2.0 * intrinsics[1, 2])))
    for focal_length, size in KITTI_SIZES.items():
        if abs(intrinsics[0, 0] - focal_length) < 1e-3:
            guess = size
    largest = [max((np.max(features[i][seen], initial=0.0) for i in rows)) for rows in ((0, 2), (1, 3))]
    return tuple(max(1, side, int(np.floor(pixel)) + 1) for side, pixel in zip(guess, largest))


def imu(stamp, angular_velocity, sigma, seq=0):
    """Gyro sample (3, rad/s); sigma is its standard deviation. -1 marks what the message does not carry (see Imu.msg)."""
    message = Imu(header=header(stamp, IMU_FRAME, seq), angular_velocity=Vector3(*angular_velocity))
    message.angular_velocity_covariance = _diagonal([sigma**2] * 3)
    message.orientation_covariance[0] = -1.0
    message.linear_acceleration_covariance[0] = -1.0
    return message


def inertial(stamp, angular_velocity, acceleration, gyro_variance, accelerometer_variance, seq=0):
    """Sample of gyro (3, rad/s) and accelerometer (3, m/s^2); variances of one coordinate, 0: not known (see Imu.msg)."""
    message = Imu(header=header(stamp, IMU_FRAME, seq), angular_velocity=Vector3(*angular_velocity),
                  linear_acceleration=Vector3(*acceleration))
    message.angular_velocity_covariance = _diagonal([gyro_variance] * 3)
    message.linear_acceleration_covariance = _diagonal([accelerometer_variance] * 3)
    message.orientation_covariance[0] = -1.0
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


def stereo_features(stamp, ids, pixels, seq=0, sigmas=None):
    """Features of one frame. ids: (N,) integers; pixels: (4, N) uL vL uR vR; sigmas: (N,) px, or None: not known."""
    sigmas = [0.0] * len(ids) if sigmas is None else sigmas
    features = [StereoFeature(int(i), *column, sigma, 0.0, b"") for i, column, sigma in zip(ids, pixels.T.tolist(), sigmas)]
    return StereoFeatureArray(header=header(stamp, LEFT_FRAME, seq), features=features)


def camera_infos(stamp, intrinsics, baseline, size, seq=0):
    """(left, right) CameraInfo of a rectified pair without distortion; the right P[0, 3] is -fx b (see CameraInfo.msg)."""
    infos = []
    for frame_id, offset in ((LEFT_FRAME, 0.0), (RIGHT_FRAME, -intrinsics[0, 0] * baseline)):
        projection = np.hstack([intrinsics, [[offset], [0.0], [0.0]]])
        infos.append(CameraInfo(header=header(stamp, frame_id, seq), width=size[0], height=size[1],
                                distortion_model="plumb_bob", D=[0.0] * 5, K=intrinsics.ravel().tolist(),
                                R=np.eye(3).ravel().tolist(), P=projection.ravel().tolist()))
    return tuple(infos)


def camera_info(stamp, frame_id, camera, seq=0):
    """CameraInfo of a recordings.recording.Camera."""
    return CameraInfo(header=header(stamp, frame_id, seq), width=camera.size[0], height=camera.size[1],
                      distortion_model=camera.model, D=list(camera.distortion), K=camera.intrinsics.ravel().tolist(),
                      R=camera.rectification.ravel().tolist(), P=camera.projection.ravel().tolist())


def compressed_image(stamp, frame_id, data, encoding, seq=0):
    """The bytes of an image file as they are; encoding: "png" or "jpeg"."""
    return CompressedImage(header=header(stamp, frame_id, seq), format=encoding, data=data)


def rig_transforms(stamp, imu_T_left, left_T_right, imu_frame=IMU_FRAME, left_frame=LEFT_FRAME, right_frame=RIGHT_FRAME):
    """IMU -> left camera -> right camera."""
    return TFMessage([_transform(stamp, imu_frame, left_frame, imu_T_left),
                      _transform(stamp, left_frame, right_frame, left_T_right)])


def static_transforms(stamp, cam_T_imu, baseline=None):
    """imu_link -> left camera and, given a baseline in m, left -> right camera. A TF child's pose is parent_T_child."""
    transforms = [_transform(stamp, IMU_FRAME, LEFT_FRAME, inverse(cam_T_imu))]
    if baseline is not None:
        transforms.append(_transform(stamp, LEFT_FRAME, RIGHT_FRAME, make_transform(np.eye(3), [baseline, 0.0, 0.0])))
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
    return np.diag(variances).ravel().tolist()
