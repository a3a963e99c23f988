"""Which format a recorded drive has, and which of the converter's options it takes."""

import os

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.dataset.npz_reader import NpzReader
from vi_ekf_slam.recordings import asl, inertial_npz, kitti

FOLDERS = ("allowed: one with mav0/cam0, cam1 and imu0 (EuRoC, TUM-VI), with image_00, image_01 and oxts (KITTI raw), or "
           "with image_0, image_1 and times.txt (KITTI odometry)")
FOLDER_OPTIONS = ("truth", "truth_body", "calibration", "skip_bad")
# By format: how to read it, and the options that mean something for it beside those that all take.
FORMATS = {
    "an .npz with a velocity": (None, ("truth", "truth_body", "without_features", "keep_stale", "extrinsic", "velocity_sigma",
                                       "gyro_sigma", "velocity_bias_sigma", "gyro_bias_sigma")),
    "an .npz with an accelerometer":
        (lambda path, options: inertial_npz.load_inertial_npz(path, options.max_memory_mb), ()),
    "a folder of EuRoC or TUM-VI": (asl.load_asl, FOLDER_OPTIONS),
    "a raw drive of KITTI": (kitti.load_kitti_raw, FOLDER_OPTIONS + ("velocity", "velocity_sigma")),
    "a sequence of KITTI's odometry": (kitti.load_kitti_odometry, FOLDER_OPTIONS),
}


def recognise(path, max_memory_mb):
    """A key of FORMATS; InputError for a folder of none of them."""
    if not os.path.isdir(path):
        with NpzReader(path, max_memory_mb) as reader:
            found = sum(key in reader.keys() for key in inertial_npz.KEYS)
            inertial = found > len(inertial_npz.KEYS) / 2  # so that one that is missing is named
        return "an .npz with an accelerometer" if inertial else "an .npz with a velocity"
    if asl.base_of(path):
        return "a folder of EuRoC or TUM-VI"
    if os.path.isdir(os.path.join(path, "image_00")):
        return "a raw drive of KITTI"
    if os.path.isdir(os.path.join(path, "image_0")):
        return "a sequence of KITTI's odometry"
    raise InputError("%s: is no drive, %s" % (path, FOLDERS))


def load_recording(options, defaults):
    """The Recording at options.input, by its format; None for an .npz with a velocity (dataset.loader).

    options: of the converter. defaults: {name: value} where nothing was said; what was said in vain is an InputError.
    """
    path = options.input
    kind = recognise(path, options.max_memory_mb)
    load, taken = FORMATS[kind]
    for name in sorted({name for _, names in FORMATS.values() for name in names} - set(taken)):
        if getattr(options, name) != defaults[name]:
            raise InputError("--%s is given, allowed for %s; %s is %s"
                             % (name.replace("_", "-"), " and ".join(k for k, (_, names) in FORMATS.items() if name in names),
                                path, kind))
    if load is None:
        return None
    try:
        return load(path, options)
    except InputError as reason:
        raise InputError(str(reason) if path in str(reason) else "%s: %s" % (path, reason))
