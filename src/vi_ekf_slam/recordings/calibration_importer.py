"""Command line of import_calibration.py: from the calibration that people have to what the node reads."""

import argparse
import os

import numpy as np

from vi_ekf_slam.common.checks import require_distinct
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.exit_status import exit_status
from vi_ekf_slam.common.output_file import check_output, write_text
from vi_ekf_slam.recordings.calibration_launch import launch_text
from vi_ekf_slam.recordings.imu_noise import UNITS, kalibr_yaml
from vi_ekf_slam.recordings.rig_calibration import read_calibration


def absolute_topic(name):
    """As a bag has it."""
    return "/" + name.lstrip("/")


def make_parser():
    parser = argparse.ArgumentParser(
        prog="import_calibration.py",
        description="Read the calibration of a rig and write a launch file that publishes it (camera_info of both cameras, "
                    "/tf_static, the IMU's noise and clock offset), or a bag that holds it. Without --output it is only "
                    "shown. FILE is Kalibr's camchain-imucam.yaml, or OpenVINS'; two files of ROS's camera_calibration, of EuRoC's "
                    "sensor.yaml or of `rostopic echo -n1 CAMERA_INFO`, left and right; or a folder of EuRoC, TUM-VI (mav0) or KITTI (calib_*.txt).",
        epilog="a_T_b takes points of b to a: imu_T_left holds the left camera's axes and position in the IMU's axes.")
    parser.add_argument("files", metavar="FILE", nargs="+")
    parser.add_argument("--imu", metavar="YAML", help="the IMU's noise: Kalibr's imu.yaml, or imu0/sensor.yaml")
    parser.add_argument("--imu-T-left", metavar="YAML", dest="imu_T_left",
                        help="where the left camera is on the IMU, goes before what FILE says: imu_T_left, T_BS, T_imu_cam or T_cam_imu")
    parser.add_argument("--output", metavar="OUT", help="OUT.launch, or with --bag OUT.bag, to write; noise goes to OUT.imu.yaml")
    parser.add_argument("--bag", metavar="IN.bag", help="the bag into whose copy the calibration goes")
    parser.add_argument("--imu-topic", metavar="TOPIC", type=absolute_topic, default="/imu",
                        help="of --bag, for the frame of the IMU (default: %(default)s)")
    parser.add_argument("--imu-frame", metavar="FRAME", help="header.frame_id of the IMU's messages (default: imu_link, or "
                        "that of --bag)")
    parser.add_argument("--left-frame", metavar="FRAME", default="left_camera_optical", help="(default: %(default)s)")
    parser.add_argument("--right-frame", metavar="FRAME", default="right_camera_optical", help="(default: %(default)s)")
    parser.add_argument("--left-info", metavar="TOPIC", type=absolute_topic, default="/left/camera_info", help="in the bag (default: %(default)s)")
    parser.add_argument("--right-info", metavar="TOPIC", type=absolute_topic, default="/right/camera_info", help="in the bag (default: %(default)s)")
    return parser


def describe(rig):
    """Lines of text: what a reader can compare with the rig in front of him."""
    left, baseline = rig.left, np.linalg.norm(rig.left_T_right[:3, 3])
    focal_length, centre = left.projection[0, [0, 2]]
    width = left.size[0 if abs(left.rectification[0, 0]) > abs(left.rectification[0, 1]) else 1]  # along the baseline
    field = np.degrees(np.arctan(centre / focal_length) + np.arctan((width - centre) / focal_length))
    x, y, z = rig.imu_T_left[:3, 3]
    lines = ["calibration: %s" % rig.format,
             "pictures: %d x %d px, %s, rectified focal length %.1f px, %.0f deg wide" % (*left.size, left.model, focal_length, field),
             "baseline: %.4f m" % baseline,
             "left camera in the IMU's axes: at (%.4f, %.4f, %.4f) m, looks along (%.3f, %.3f, %.3f), its right is "
             "(%.3f, %.3f, %.3f)" % (x, y, z, *rig.imu_T_left[:3, 2], *rig.imu_T_left[:3, 0])]
    if rig.noise is None:
        lines.append("IMU noise: not stated (--imu FILE)")
    else:
        lines += ["IMU noise: gyro %g %s, its bias %g %s" % (rig.noise[0], UNITS[0], rig.noise[1], UNITS[1]),
                  "           accelerometer %g %s, its bias %g %s" % (rig.noise[2], UNITS[2], rig.noise[3], UNITS[3])]
    if rig.time_offset is not None:
        lines.append("clock: a picture's stamp plus %.6f s is the IMU's (calibration/time_offset)" % rig.time_offset)
    return lines + list(rig.notes)


def import_calibration(options):
    """Do what the parsed options ask; InputError when something is refused."""
    suffix = ".launch" if options.bag is None else ".bag"
    if options.bag is not None and options.output is None:
        raise InputError("--bag needs --output OUT.bag")
    if options.output is not None:
        check_output(options.output, options.bag, suffix)
    rig = read_calibration(options.files, options.imu, options.imu_T_left)
    print("\n".join(describe(rig)))
    if options.output is None:
        return
    stem = options.output[:-len(suffix)]
    noise_file = None if rig.noise is None else stem + ".imu.yaml"
    frames = [options.imu_frame or "imu_link", options.left_frame, options.right_frame]
    for frame in frames:
        if not frame or frame.startswith("/") or not frame.isprintable() or any(c in frame for c in " \"'<>&"):
            raise InputError("a frame is '%s', allowed: a name without spaces and quotes and without a leading slash" % frame)
    if noise_file:
        for source in [options.imu, options.imu_T_left] + options.files:
            check_output(noise_file, source)
    if options.bag is None:
        require_distinct(frames)
        text = launch_text(rig, frames, noise_file and os.path.basename(noise_file))
        write_text(options.output, text)
    else:
        from vi_ekf_slam.bag.calibration_writer import add_calibration  # needs ROS; complain about inputs first
        count, replaced = add_calibration(options, rig)
        print("bag: %d messages, of them %d of camera_info replaced" % (count, replaced))
        own = noise_file and "inertial: {imu_calibration: %s}" % os.path.abspath(noise_file)
        own = [own, rig.time_offset and "calibration: {time_offset: %.9f}" % rig.time_offset]
        if any(own):
            print("\n".join(["a bag has no place for the rest; the configuration needs:"] + ["  " + line for line in own if line]))
    if noise_file:
        write_text(noise_file, kalibr_yaml(rig.noise, options.imu_topic))
    print("\n".join("wrote: %s" % path for path in (options.output, noise_file) if path))


def main(argv=None):
    """Entry point: 0 on success, 2 and one line on stderr when something is refused."""
    return exit_status(import_calibration, make_parser().parse_intermixed_args(argv))
