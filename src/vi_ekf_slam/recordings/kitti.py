"""KITTI's raw drives (image_00, oxts ...) and odometry sequences (image_0, calib.txt, times.txt ...)."""

import os

import numpy as np

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import BODY_R_OPTICAL, inverse, make_transform, so3_exp
from vi_ekf_slam.recordings import truth_poses
from vi_ekf_slam.recordings.image_files import Faults, image_size, list_images, whole_pairs
from vi_ekf_slam.recordings.kitti_files import NO_STAMP, Calibration, only_increasing, read_lines, read_oxts, read_timestamps
from vi_ekf_slam.recordings.recording import Images, Imu, Recording, Velocity, rectified_pair

EARTH_RADIUS = 6378137.0  # m, of the development kit's Mercator projection
ODOMETRY_START = 10**9  # ns, added to times.txt: ROS takes a stamp of zero for none
# Columns of oxts, see its dataformat.txt: x forward, y left, z up; the accelerometers feel gravity. The velocity is along
# the earth's surface and upwards.
LATITUDE, LONGITUDE, ALTITUDE, ROLL, PITCH, YAW = range(6)
LEVEL_VELOCITY, ACCELERATION, RATE = slice(8, 11), slice(11, 14), slice(17, 20)


def load_kitti_raw(folder, options):
    """Read and check a raw drive; a Recording. options: calibration, skip_bad, truth, truth_body, velocity and
    velocity_sigma of the converter."""
    faults = Faults(options.skip_bad)
    left, right, cam_T_imu, baseline = calibrated_pair(*(
        _calibration(folder, options, "calib_%s.txt" % name) for name in ("cam_to_cam", "imu_to_velo", "velo_to_cam")))

    rows = read_timestamps(os.path.join(folder, "image_00", "timestamps.txt"), faults)
    folders = [os.path.join(folder, name, "data") for name in ("image_00", "image_01")]
    frames, images = _numbered_pairs(folders, rows, 10, left.size, faults)
    stamps, oxts = read_oxts(os.path.join(folder, "oxts"), faults)
    recording = Recording(
        os.path.basename(os.path.abspath(folder)), images=images, left=left, right=right, imu_T_left=inverse(cam_T_imu),
        left_T_right=make_transform(np.eye(3), [baseline, 0.0, 0.0]),
        imu=Imu(stamps, oxts[:, RATE], oxts[:, ACCELERATION], None))
    if options.velocity:
        recording.velocity = Velocity(stamps, oxts_velocities(oxts), options.velocity_sigma)
    path = options.truth or os.path.join(folder, "truth_left_camera.txt")
    if options.truth or os.path.exists(path):
        first = int(np.argmin(np.abs(stamps - rows[0])))
        upright = oxts_rotation(*oxts[first, [ROLL, PITCH]], 0.0)
        found = truth_poses.file_truth(path, options.truth_body, rows, recording.imu_T_left, upright, faults)
        recording.notes.append("truth from: %s, roll and pitch of the start from oxts" % path)
    else:
        found = stamps, oxts_poses(oxts)
        recording.notes.append("truth from: oxts (GPS and INS, by the Mercator projection)")
    recording.truth = truth_poses.within(*found, recording.start, max(frames[-1], stamps[-1]), options.truth)
    recording.notes += faults.notes()
    return recording


def calibrated_pair(cam_to_cam, imu_to_velo, velo_to_cam):
    """(left, right recording.Camera of the rectified pictures, cam_T_imu 4 x 4, baseline m) of the three files."""
    cameras = Calibration(cam_to_cam)
    velo_T_imu, cam_T_velo = Calibration(imu_to_velo).transform(), Calibration(velo_to_cam).transform()
    intrinsics, offset, baseline = cameras.rectified("P_rect_00", "P_rect_01")
    rectified_T_cam = make_transform(cameras.rotation("R_rect_00"), [-offset, 0.0, 0.0])
    size = tuple(int(n) for n in cameras.matrix("S_rect_00", 2))
    return rectified_pair(size, intrinsics, baseline) + (rectified_T_cam @ cam_T_velo @ velo_T_imu, baseline)


def load_kitti_odometry(folder, options):
    """Read and check an odometry sequence, which has no IMU; a Recording. options: as load_kitti_raw."""
    faults = Faults(options.skip_bad)
    intrinsics, _, baseline = Calibration(_calibration(folder, options, "calib.txt")).rectified("P0", "P1")
    times = os.path.join(folder, "times.txt")
    try:
        seconds = np.array([float(line) for line in read_lines(times)])
    except ValueError as reason:
        raise InputError("%s: %s, allowed: a number of seconds a line" % (times, reason))
    if not np.all(np.isfinite(seconds)) or seconds.min() < 0.0:
        raise InputError("%s: holds %g, allowed: seconds from 0 on" % (times, seconds.min()))
    rows = only_increasing(ODOMETRY_START + np.rint(seconds * 1e9).astype(np.int64), times, faults)
    folders = [os.path.join(folder, name) for name in ("image_0", "image_1")]
    _, images = _numbered_pairs(folders, rows, 6, None, faults)
    size = image_size(images.left[0])
    left, right = rectified_pair(size, intrinsics, baseline)
    recording = Recording(
        os.path.basename(os.path.abspath(folder)), images=images, left=left, right=right,
        imu_T_left=make_transform(BODY_R_OPTICAL, np.zeros(3)),
        left_T_right=make_transform(np.eye(3), [baseline, 0.0, 0.0]),
        notes=["stamps: times.txt and 1 s", "IMU: none; the body is the left camera, x forward"])
    number = os.path.basename(os.path.abspath(folder))
    beside = [os.path.join(folder, "poses.txt"), os.path.join(folder, "..", "..", "poses", number + ".txt")]
    path = options.truth or next(filter(os.path.exists, beside), None)
    if path:
        found = truth_poses.file_truth(path, options.truth_body, rows, recording.imu_T_left, np.eye(3), faults)
        recording.truth = truth_poses.within(*found, recording.start, int(images.stamps[-1]), options.truth)
        recording.notes.append("truth from: %s, upwards where the first picture has it" % path)
    recording.notes += faults.notes()
    return recording


def oxts_rotation(roll, pitch, yaw):
    """World_R_imu: rad, about x, y and z, as the development kit composes them."""
    return so3_exp([0, 0, yaw]) @ so3_exp([0, pitch, 0]) @ so3_exp([roll, 0, 0])


def oxts_velocities(rows):
    """Velocities (N, 3) of oxts rows in the IMU's axes, m/s."""
    return np.array([oxts_rotation(*row[[ROLL, PITCH]], 0.0).T @ row[LEVEL_VELOCITY] for row in rows])


def oxts_poses(rows):
    """World_T_imu (N, 4, 4) of oxts rows: east, north, up, by the Mercator projection at the first latitude."""
    scale = np.cos(np.radians(rows[0, LATITUDE]))
    east = scale * EARTH_RADIUS * np.radians(rows[:, LONGITUDE])
    north = scale * EARTH_RADIUS * np.log(np.tan(np.radians(90.0 + rows[:, LATITUDE]) / 2.0))
    positions = np.column_stack([east, north, rows[:, ALTITUDE]])
    return np.array([make_transform(oxts_rotation(*row[[ROLL, PITCH, YAW]]), position - positions[0])
                     for row, position in zip(rows, positions)])


def _calibration(folder, options, name):
    """Path of a calibration file: in --calibration's folder, in the drive's, or in that of its date, as KITTI packs them."""
    places = [options.calibration] if options.calibration else [folder, os.path.dirname(os.path.abspath(folder))]
    for place in places:
        path = os.path.join(place, name)
        if os.path.exists(path):
            return path
    raise InputError("%s: has no %s, allowed: there, in the folder above, or --calibration FOLDER" % (folder, name))


def _numbered_pairs(folders, stamps, digits, size, faults):
    """(stamps, Images) of files that are numbered like the rows of `stamps`. size: None: that of the first whole one."""
    files = [list_images(folder) for folder in folders]
    pairs = []
    for k, stamp in enumerate(stamps):
        paths = [found.pop("%0*d" % (digits, k), None) for found in files]
        for folder, path in zip(folders, paths):
            if path is None:
                faults.add("%s: has no picture %0*d" % (folder, digits, k))
        if all(paths) and stamp != NO_STAMP:
            pairs.append((stamp, *paths))
    for path in [path for found in files for path in found.values()]:
        faults.add("%s: has no stamp" % path)
    if size is None:
        size = _first_size(pairs)
    kept, lefts, rights = zip(*whole_pairs(pairs, size, faults))
    kept = np.array(kept, dtype=np.int64)
    return kept, Images(kept, lefts, rights)


def _first_size(pairs):
    for _, left, _ in pairs:
        try:
            return image_size(left)
        except InputError:
            continue
    return (0, 0)
