"""What camera_info and /tf_static state: is it a rectified pair at all, and where is it on the IMU?"""

import numpy as np

from vi_ekf_slam.bag.transforms import matrix_of
from vi_ekf_slam.common.geometry import make_transform, rotation_error
from vi_ekf_slam.recordings.rig_calibration import MAX_VERTICAL, PIXEL_TOLERANCE, ROS_MODELS, without_surplus

MAX_FIELD = (20.0, 150.0)  # deg, horizontal field of view of a rectified picture: lenses beyond are not what a pinhole is for
# Share of the picture's width and height from its middle: lenses are centred to a twentieth, and K of a picture of half or twice the
# size is off by a quarter and more.
MAX_OFF_CENTRE = 0.15
MAX_LEVER = 10.0  # m, camera on the IMU: larger vehicles exist, but mm instead of m are more frequent
COEFFICIENTS = {model: counts if counts == (4,) else (0,) + counts for model, counts in ROS_MODELS.items()}  # of D, by the model
MIN_BASELINE, MAX_BASELINE = 0.02, 2.0  # m, of rigs that are sold or built


class Camera:
    """One side: K, D, R, P of sensor_msgs/CameraInfo as arrays, and what becomes of pixels."""

    def __init__(self, info):
        self.K = np.array(info.K).reshape(3, 3)
        self.D = without_surplus(info.distortion_model, np.array(info.D, dtype=float))
        rotation = np.array(info.R).reshape(3, 3)
        self.R = rotation if rotation.any() else np.eye(3)
        self.P = np.array(info.P).reshape(3, 4)
        self.size = info.width, info.height
        self.fisheye = info.distortion_model in ("equidistant", "fisheye")

    @property
    def is_rectified(self):
        """Whether nothing is left to rectify, as the front end judges it (front_end/camera_model.cpp)."""
        return (not self.D.any() and not self.fisheye and np.abs(self.R - np.eye(3)).max() < 1e-9
                and (not self.K.any() or np.linalg.norm(self.K - self.P[:, :3]) <= 1e-3))

    def rectify(self, pixels):
        """(N, 2) px of the picture as it is -> (N, 2) px of the rectified one."""
        import cv2
        if not len(pixels):
            return np.zeros((0, 2))
        points = np.ascontiguousarray(pixels, dtype=float).reshape(-1, 1, 2)
        undistort = cv2.fisheye.undistortPoints if self.fisheye else cv2.undistortPoints
        return undistort(points, self.K, self.D, R=self.R, P=self.P).reshape(-1, 2)

    def magnifications(self, pixels):
        """(N,): how many px of the rectified picture one of the picture as it is is long there, where it is longest."""
        sides = [self.rectify(pixels + step) - self.rectify(pixels - step) for step in 0.5 * np.eye(2)]
        return np.linalg.norm(np.stack(sides, axis=-1), ord=2, axis=(1, 2))


def check_calibration(rig, report):
    """camera_info by itself: P of both sides, baseline, picture's size."""
    if set(rig.infos) != {"left", "right"}:
        report.unjudged("camera_info of both sides is needed")
        return
    left, right = (rig.infos[side] for side in ("left", "right"))
    fault = _fault(left, "left") or _fault(right, "right") or _pair_fault(left, right)
    if fault is None and "features" not in rig.streams:
        fault = _lens_fault(left, "left") or _lens_fault(right, "right")
    if fault is not None:
        report.red(*fault)
        return
    if rig.changed:
        report.yellow("camera_info changes on the way", ", ".join(sorted(rig.changed)), "constant",
                      "the first one is used: stop what re-calibrates, or crops")
    rig.cameras = Camera(left), Camera(right)
    baseline = -right.P[3] / right.P[0]
    across = rig.cameras[0].R[0]  # the baseline in the picture: along its columns where R turns by 90 deg
    field = 2.0 * np.degrees(np.arctan(0.5 * rig.cameras[0].size[int(abs(across[1]) > abs(across[0]))] / left.P[0]))
    figure = "baseline %.4g m, %.4g px, %.0f deg wide" % (baseline, left.P[0], field)
    if not MIN_BASELINE <= baseline <= MAX_BASELINE:
        report.yellow("the baseline is unusual", "%.4g m" % baseline, "%g to %g m" % (MIN_BASELINE, MAX_BASELINE),
                      "right P[3] is -fx times the baseline in m: is it in mm?")
    elif field and not MAX_FIELD[0] <= field <= MAX_FIELD[1]:
        report.yellow("focal length and width do not go together", figure, "%g to %g deg" % MAX_FIELD,
                      "is camera_info that of another resolution?")
    elif max(map(_off_centre, rig.cameras)) > MAX_OFF_CENTRE:
        worse = max(rig.cameras, key=_off_centre)
        report.yellow("the principal point is far from the middle of the picture", "K: at %.0f, %.0f of %d x %d px" % (
            worse.K[0, 2], worse.K[1, 2], *worse.size), "within %g of width and height" % MAX_OFF_CENTRE,
                      "is K that of another resolution, or of a crop?")
    else:
        report.green("camera_info describes a rectified pair", figure)


def _off_centre(camera):
    """Of the principal point, as a share of the picture's size; 0 where either is not stated."""
    if not (camera.K.any() and all(camera.size)):
        return 0.0
    return float(np.abs((camera.K[:2, 2] + 0.5) / camera.size - 0.5).max())


def _fault(info, side):
    topic, P = "%s/camera_info" % side, info.P
    if not np.isfinite(P).all() or not (P[0] > 1.0 and P[5] > 1.0):
        return ("%s: not calibrated" % topic, "P: fx %g, fy %g" % (P[0], P[5]), "finite, from 1 px on",
                "calibrate: rosrun camera_calibration, or Kalibr")
    if P[1] or P[4] or P[8] or P[9] or P[10] != 1.0:
        return ("%s: P is none of a rectified camera" % topic, "P[1], P[4], P[8], P[9], P[10]: %g, %g, %g, %g, %g" % (
            P[1], P[4], P[8], P[9], P[10]), "[fx 0 cx Tx; 0 fy cy Ty; 0 0 1 0]", "calibrate again, or mend what writes it")
    if rotation_error(Camera(info).R) > 1e-3:
        return ("%s: R is no rotation" % topic, "", "R^T R = I within 1e-3", "calibrate again")
    if info.binning_x > 1 or info.binning_y > 1 or info.roi.x_offset or info.roi.y_offset:
        return ("%s has binning or a region of interest" % topic, "binning %d x %d, region at %d, %d" % (
            info.binning_x, info.binning_y, info.roi.x_offset, info.roi.y_offset), "none: not supported",
                "set the camera to its full picture, or calibrate the one that it sends")
    return None


def _lens_fault(info, side):
    """What the front end refuses (ros/front_end/pair_calibration.cpp)."""
    topic, model, count = "%s/camera_info" % side, info.distortion_model, len(without_surplus(info.distortion_model, info.D))
    if not (info.width and info.height):
        return ("%s does not say how large its pictures are" % topic, "%d x %d px" % (info.width, info.height), "width and height",
                "set both to the size of the pictures that K and P are of")
    if not model and not any(info.D):
        return None
    if model not in COEFFICIENTS:
        return ("%s: distortion_model is unknown" % topic, "'%s'" % model, ", ".join(m for m in COEFFICIENTS),
                "calibrate with one of these; or, where the pictures are rectified already, front_end/images: rectified")
    if count not in COEFFICIENTS[model]:
        return ("%s: D does not fit its model" % topic, "%d coefficients (%s)" % (count, model), " or ".join(
            str(n) for n in COEFFICIENTS[model]), "calibrate again, or leave out those that are too many if they are 0")
    return None


def _pair_fault(left, right):
    if left.P[3] < 0.0 and right.P[3] == 0.0:
        return ("left and right camera_info are exchanged", "left P[3] %.4g, right P[3] 0" % left.P[3], "left 0, right negative",
                "exchange the camera_info topics: left_info:=..., right_info:=...")
    vertical = max(abs(left.P[7]), abs(right.P[7]))
    if vertical > max(PIXEL_TOLERANCE, MAX_VERTICAL * abs(right.P[3])):
        return ("the cameras are one above the other" if vertical > abs(right.P[3]) else "the baseline has a vertical part",
                "P[3], P[7]: left %.4g, %.4g, right %.4g, %.4g" % (left.P[3], left.P[7], right.P[3], right.P[7]), "P[7] 0",
                "let import_calibration.py turn it by 90 deg: of the calibration's files, or of both camera_info by `rostopic echo -n1`"
                if vertical > abs(right.P[3]) else "rectify the pair again")
    if left.P[3] == 0.0 and right.P[3] > 0.0:
        return ("camera_info states that the right camera is on the left", "right P[3] %.4g" % right.P[3],
                "negative, -fx times the baseline",
                "exchange left and right, pictures and camera_info both; or mend the sign of right P[3]")
    if left.P[3] != 0.0 or not right.P[3] < 0.0:
        return ("camera_info states no baseline", "P[3]: left %.4g, right %.4g" % (left.P[3], right.P[3]), "left 0, right negative",
                "right P[3] must be -fx times the baseline in m: calibrate as a stereo pair")
    for index, name in ((0, "fx"), (5, "fy"), (2, "cx"), (6, "cy")):
        if abs(left.P[index] - right.P[index]) > PIXEL_TOLERANCE:
            return ("camera_info is not of a rectified pair", "%s: left %.6g, right %.6g px" % (name, left.P[index], right.P[index]),
                    "equal", "calibrate as a stereo pair: P of both sides must share fx, fy, cx, cy")
    if (left.width, left.height) != (right.width, right.height):
        return ("left and right camera_info are of two sizes", "%d x %d and %d x %d" % (
            left.width, left.height, right.width, right.height), "equal", "set both cameras to one resolution")
    return None


def check_extrinsic(rig, report):
    """Is there a transform from the IMU to the camera, and could it be one?"""
    if "imu" not in rig.streams or "left" not in rig.infos:
        report.unjudged("it needs an IMU and left/camera_info")
        return
    imu, camera = rig.streams["imu"].frame_id, rig.infos["left"].header.frame_id.lstrip("/")
    if imu == camera:
        report.red("IMU and left camera are said to be one frame", "frame_id '%s'" % imu, "two frames",
                   "give each its own frame_id, and publish the transform on /tf_static")
        return
    left_T_imu = rig.left_T_imu()
    if left_T_imu is None:
        links = ", ".join(sorted("%s -> %s%s" % (t.header.frame_id, t.child_frame_id,
                                                 " (not finite, or no unit quaternion)" if matrix_of(t.transform) is None else "")
                                 for t in rig.transforms)) or "none"
        report.red("no transform from '%s' to '%s'" % (imu, camera), "/tf_static: " + links, "required",
                   "publish it: rosrun tf2_ros static_transform_publisher X Y Z QX QY QZ QW %s %s (where the camera is on the IMU)" % (
                       imu or "IMU_FRAME", camera or "CAMERA_FRAME"))
        return
    rig.cam_T_imu = make_transform(Camera(rig.infos["left"]).R, np.zeros(3)) @ left_T_imu
    distance = float(np.linalg.norm(left_T_imu[:3, 3]))
    if distance > MAX_LEVER:
        report.yellow("the camera is far from the IMU", "%.4g m" % distance, "%g m" % MAX_LEVER, "translations are in m, not in mm")
    else:
        report.green("'%s' is known on '%s'" % (camera, imu), "%.3g m off" % distance, "%g m" % MAX_LEVER)
