"""The launch file of a calibration: parameters of the node publish_calibration.py, and two of the SLAM node's own."""

from xml.sax.saxutils import quoteattr

import yaml

from vi_ekf_slam.common.yaml_file import yaml_number

TEMPLATE = """<?xml version="1.0"?>
<!--
  Calibration of a rig, written by import_calibration.py ({source}).
  roslaunch vi_ekf_slam rig.launch calibration:=THIS_FILE ...
-->
<launch>
  <arg name="left_info" default="left/camera_info"/>
  <arg name="right_info" default="right/camera_info"/>
  <node pkg="vi_ekf_slam" type="publish_calibration.py" name="publish_calibration" output="screen">
    <remap from="left/camera_info" to="$(arg left_info)"/>
    <remap from="right/camera_info" to="$(arg right_info)"/>
    <rosparam>
{parameters}    </rosparam>
  </node>
{own}</launch>
"""
OWN_NOISE = '  <param name="slam/inertial/imu_calibration" value={file}/>\n'
OWN_OFFSET = """  <!-- s, to be added to a picture's stamp to have that of the IMU's clock -->
  <param name="slam/calibration/time_offset" type="double" value="{value}"/>
"""


def camera_parameters(camera, frame):
    """A recording.Camera as plain data, by the names of sensor_msgs/CameraInfo."""
    return {"frame_id": frame, "width": int(camera.size[0]), "height": int(camera.size[1]),
            "distortion_model": camera.model, "D": _numbers(camera.distortion), "K": _numbers(camera.intrinsics),
            "R": _numbers(camera.rectification), "P": _numbers(camera.projection)}


def launch_text(rig, frames, noise_file):
    """Text of the launch file. frames: of IMU, left, right camera; noise_file: name of what lies beside it, or None."""
    imu, left, right = frames
    parameters = {"imu_frame": imu, "left": camera_parameters(rig.left, left), "right": camera_parameters(rig.right, right),
                  "imu_T_left": _numbers(rig.imu_T_left), "left_T_right": _numbers(rig.left_T_right)}
    text = yaml.safe_dump(parameters, default_flow_style=None, sort_keys=False, width=100)
    own = OWN_NOISE.format(file=quoteattr("$(dirname)/" + noise_file)) if noise_file else ""
    if rig.time_offset is not None:
        own += OWN_OFFSET.format(value=yaml_number(rig.time_offset))
    return TEMPLATE.format(source=rig.format, own=own, parameters="".join("      %s\n" % line for line in text.splitlines()))


def _numbers(array):
    return [float(value) for value in array.ravel()]
