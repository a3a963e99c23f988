"""A drive in the layout of EuRoC and TUM-VI (ASL): mav0/cam0, cam1, imu0, each with data.csv and, mostly, sensor.yaml.

The calibration is Kalibr's camchain where there is one (*camchain*.yaml in the folder, in mav0 or dso), else sensor.yaml.
The IMU's noise is that of imu0/sensor.yaml or of imu.yaml, imu_config.yaml beside the camchain. Truth is
mav0/state_groundtruth_estimate0 or mocap0 (data.csv), or truth_imu.tum.
"""

import glob
import os

import numpy as np

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse
from vi_ekf_slam.common.yaml_file import read_mapping
from vi_ekf_slam.recordings import truth_poses
from vi_ekf_slam.recordings.calibration_files import camchain, contradictions, sensor_camera, sensor_pose, timeshift
from vi_ekf_slam.recordings.csv_table import read_rows, read_stamp, read_table
from vi_ekf_slam.recordings.image_files import Faults, list_images, whole_pairs
from vi_ekf_slam.recordings.imu_noise import KEYS, noise_from_yaml
from vi_ekf_slam.recordings.recording import Images, Imu, Recording, require_increasing
from vi_ekf_slam.recordings.rectification import rectify
from vi_ekf_slam.recordings.stamp_pairs import mutual_pairs


def base_of(folder):
    """The folder that holds cam0, or None."""
    for base in (os.path.join(folder, "mav0"), folder):
        if os.path.isdir(os.path.join(base, "cam0")):
            return base
    return None


def load_asl(folder, options):
    """Read and check a folder; a Recording. options: calibration, skip_bad, truth and truth_body of the converter."""
    base, faults = base_of(folder), Faults(options.skip_bad)
    for name in ("cam0", "cam1", "imu0"):
        if not os.path.isdir(os.path.join(base, name)):
            raise InputError("%s: has no folder %s, allowed: cam0, cam1 and imu0" % (base, name))
    chain = options.calibration or find(folder, base, "*camchain*.yaml")
    imu_yaml = os.path.join(base, "imu0", "sensor.yaml")
    imu_values = read_mapping(imu_yaml) if os.path.exists(imu_yaml) else {}
    body_T_imu = sensor_pose(imu_values, imu_yaml) if "T_BS" in imu_values or not chain else np.eye(4)
    if chain:
        left, right = camchain(chain)
    else:
        left, right = (sensor_camera(os.path.join(base, name, "sensor.yaml"), body_T_imu) for name in ("cam0", "cam1"))
    left_info, right_info = rectify(left, right, chain or base)
    stamps, twist = read_table(os.path.join(base, "imu0", "data.csv"), 6, faults)
    images, apart = _images(base, left.size, faults)
    recording = Recording(
        os.path.basename(os.path.abspath(folder)), imu=Imu(stamps, twist[:, :3], twist[:, 3:], None), images=images,
        left=left_info, right=right_info, imu_T_left=left.imu_T_cam, left_T_right=inverse(left.imu_T_cam) @ right.imu_T_cam,
        notes=["calibration: %s" % (chain or "sensor.yaml")])
    if apart:
        recording.notes.append("stereo pairs: stamps differ by up to %.3f ms, the left picture's is that of both" % (1e-6 * apart))
    shift = timeshift(chain) if chain else None
    if shift:
        recording.notes.append("clock: give calibration/time_offset: %.9f in the configuration; a bag has no place for it" % shift)
    recording.notes += contradictions(chain, left, right) if chain else []
    noise = noise_of(folder, base)
    if noise is None:
        recording.notes.append("noise of the IMU: not stated")
    recording.imu = recording.imu._replace(noise=noise)
    recording.truth, source = _truth(folder, base, recording, body_T_imu, options, faults)
    recording.notes.append("truth from: %s" % source)
    recording.notes += faults.notes()
    return recording


def find(folder, base, pattern):
    """The first file of that name where such folders have it, or None."""
    for place in (folder, base, os.path.join(folder, "dso")):
        found = sorted(glob.glob(os.path.join(glob.escape(place), pattern)))
        if found:
            return found[0]
    return None


def noise_of(folder, base):
    """ImuNoise that the folder states, or None."""
    imu_yaml = os.path.join(base, "imu0", "sensor.yaml")
    imu_values = read_mapping(imu_yaml) if os.path.exists(imu_yaml) else {}
    if KEYS[0] in imu_values:
        return noise_from_yaml(imu_values, "rate_hz", imu_yaml)
    for name in ("imu.yaml", "imu_config.yaml"):
        path = find(folder, base, name)
        if path:
            values = read_mapping(path)
            return noise_from_yaml(values.get("imu0", values), "update_rate", path)
    return None


def _images(base, size, faults):
    """(Images, ns between the stamps of a pair at most), of mutual_pairs."""
    left, right = (_camera_images(os.path.join(base, name), faults) for name in ("cam0", "cam1"))
    lefts, rights = sorted(left), sorted(right)
    beside = {lefts[i]: rights[j] for i, j in mutual_pairs(np.array(lefts, np.int64), np.array(rights, np.int64))}
    for one, paired, name in ((left, set(beside), "cam1"), (right, set(beside.values()), "cam0")):
        for stamp in sorted(set(one) - paired):
            faults.add("%s: has no picture beside %s" % (os.path.join(base, name), one[stamp]))
    pairs = whole_pairs([(stamp, left[stamp], right[beside[stamp]]) for stamp in sorted(beside)], size, faults)
    stamps, lefts, rights = zip(*pairs)
    stamps = np.array(stamps, dtype=np.int64)
    require_increasing(stamps, os.path.join(base, "cam0"))
    return Images(stamps, lefts, rights), max(abs(beside[stamp] - stamp) for stamp in stamps.tolist())


def _camera_images(camera, faults):
    """{stamp ns: path} of a camera's folder: by its data.csv, or by the files' names where there is none."""
    files, table = list_images(os.path.join(camera, "data")), os.path.join(camera, "data.csv")
    if not os.path.exists(table):
        return {read_stamp(path, 0, stem): path for stem, path in files.items()}
    listed = {}
    for number, words in read_rows(table):
        stamp = read_stamp(table, number, words[0])
        stem = os.path.splitext(words[1] if len(words) > 1 else "")[0]
        if stamp in listed:
            faults.add("%s: line %d repeats the stamp %d" % (table, number, stamp))
            files.pop(stem, None)
        elif stem not in files:
            faults.add("%s: line %d names '%s', which is not there" % (table, number, ",".join(words[1:])))
        else:
            listed[stamp] = files.pop(stem)
    for path in files.values():
        faults.add("%s: is not in data.csv" % path)
    return listed


def _truth(folder, base, recording, body_T_imu, options, faults):
    """(truth of a Recording or None, where it is from)."""
    frames = recording.frame_stamps
    where = (None if len(faults) else frames, recording.imu_T_left, np.eye(3), faults)
    if options.truth:
        source = options.truth
        found = truth_poses.file_truth(source, options.truth_body, *where)
    else:
        tables = [os.path.join(base, name, "data.csv") for name in ("state_groundtruth_estimate0", "mocap0")]
        source = next(filter(os.path.exists, tables + [os.path.join(folder, "truth_imu.tum")]), None)
        if source is None:
            return None, "none"
        if source.endswith(".csv"):
            stamps, world_T_body = truth_poses.asl_truth(source, faults)
            found = stamps, world_T_body @ body_T_imu
        else:
            found = truth_poses.file_truth(source, "imu", *where)
    truth = truth_poses.within(*found, recording.start, max(frames[-1], recording.imu.stamps[-1]), options.truth)
    return (truth, source) if truth is not None else (None, "none (%s is of another time)" % source)
