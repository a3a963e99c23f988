"""The node publish_calibration.py: a calibration from its parameters to camera_info and /tf_static, both latched.

import_calibration.py writes the launch file with the parameters. A bad one ends the node with status 2.
"""

import rospy
from sensor_msgs.msg import CameraInfo
from tf2_ros import StaticTransformBroadcaster

from vi_ekf_slam.bag import messages as make
from vi_ekf_slam.common import checks
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.recordings.calibration_files import matrix, numbers, transform
from vi_ekf_slam.recordings.recording import Camera
from vi_ekf_slam.ros.node_arguments import take_ros_arguments


def parameter(values, key, name):
    """values[key]; InputError names what is missing."""
    if not isinstance(values, dict) or key not in values:
        raise InputError("parameter %s/%s is missing" % (name, key))
    return values[key]


def camera_of(values, name):
    """(frame, recording.Camera) of a camera's parameters."""
    def array(key, shape):
        return matrix(parameter(values, key, name), shape, "parameter %s/%s" % (name, key))
    frame = str(parameter(values, "frame_id", name))
    if not frame:
        raise InputError("parameter %s/frame_id is empty, allowed: a frame" % name)
    size = []
    for key in ("width", "height"):
        value = parameter(values, key, name)
        if not isinstance(value, int) or value < 1:
            raise InputError("parameter %s/%s is %r, allowed: a number of pixels" % (name, key, value))
        size.append(value)
    K, P = array("K", (3, 3)), array("P", (3, 4))
    checks.require_intrinsics(K, "parameter %s/K" % name)
    checks.require_intrinsics(P[:, :3], "parameter %s/P" % name)
    distortion = numbers(parameter(values, "D", name), (None,), "parameter %s/D" % name)
    return frame, Camera(tuple(size), K, str(parameter(values, "distortion_model", name)), distortion, array("R", (3, 3)), P)


def publish():
    """Send everything once; returns what must stay alive for it to stay latched."""
    values = rospy.get_param("~", {})
    name = rospy.get_name()
    imu_frame = str(parameter(values, "imu_frame", name))
    (left_frame, left), (right_frame, right) = (camera_of(parameter(values, side, name), "%s/%s" % (name, side))
                                                for side in ("left", "right"))
    transforms = [transform(parameter(values, key, name), "parameter %s/%s" % (name, key))
                  for key in ("imu_T_left", "left_T_right")]
    now = rospy.Time.now()
    broadcaster = StaticTransformBroadcaster()
    broadcaster.sendTransform(make.rig_transforms(now, *transforms, imu_frame, left_frame, right_frame).transforms)
    publishers = [broadcaster]
    for topic, frame, camera in (("left/camera_info", left_frame, left), ("right/camera_info", right_frame, right)):
        publisher = rospy.Publisher(topic, CameraInfo, queue_size=1, latch=True)
        publisher.publish(make.camera_info(now, frame, camera))
        publishers.append(publisher)
        rospy.loginfo("calibration: %s in %s, %d x %d px", publisher.resolved_name, frame, *camera.size)
    rospy.loginfo("calibration: /tf_static from %s to %s", imu_frame, left_frame)
    return publishers


def main():
    """Entry point: 0 when it is told to end, 2 when a parameter is refused."""
    take_ros_arguments(__doc__)
    rospy.init_node("publish_calibration")
    try:
        alive = publish()
    except InputError as reason:
        rospy.logfatal("publish_calibration: %s", reason)
        return 2
    rospy.spin()
    del alive
    return 0
