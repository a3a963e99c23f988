"""simulate_dataset.py --images: a drive with stereo pictures and an IMU, from nothing, as a folder in EuRoC's layout."""

import argparse
import os
import shutil
import sys
import tempfile

import numpy as np
from tqdm import tqdm

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import BODY_R_OPTICAL, inverse, make_transform, rotation_to_quaternion, so3_exp
from vi_ekf_slam.recordings.imu_noise import KEYS, ImuNoise
from vi_ekf_slam.simulation.pictures.motion import MOTIONS, felt, velocity

START = 1600000000 * 10**9  # ns
NOISE = ImuNoise(1.7e-4, 2e-5, 2e-3, 3e-3, 200.0)  # an ordinary MEMS IMU
BIAS_SIGMAS = (0.003, 0.03)  # rad/s, m/s^2: of gyro and accelerometer at the start
FRAME_DELAY = 2100000  # ns; a camera's clock does not tick with the IMU's
LENSES = ("pinhole", "radtan", "fisheye")
BASELINES = {"street": 0.3, "room": 0.11}  # m
NEAR = 3.0  # m, about the nearest that is seen from a street or in a room
CAMERA_IN_IMU = np.array([0.15, 0.0, 0.05])  # m, the middle of the pair
JPEG_QUALITY = 95


def make_parser():
    parser = argparse.ArgumentParser(
        prog="simulate_dataset.py --images",
        description="Draw a drive of stereo pictures with an IMU and write it as the folder OUT in EuRoC's layout "
                    "(dataset_to_bag.py takes it), with the true states. It begins with 2 s of rest.")
    parser.add_argument("output", metavar="OUT")
    parser.add_argument("--images", action="store_true", help="this: a drive with pictures")
    parser.add_argument("--scene", choices=sorted(MOTIONS), default="street",
                        help="a car in a street, or a rig in a hand in a room (default: %(default)s)")
    parser.add_argument("--lens", choices=LENSES, default=LENSES[0],
                        help="pinhole: pictures that are rectified; radtan: a lens as EuRoC's, and fisheye: as TUM-VI's, which "
                             "sees 195 deg, both with a right camera that is turned by 0.6 deg (default: %(default)s)")
    parser.add_argument("--duration", type=float, default=60.0, metavar="S", help="s (default: %(default)g)")
    parser.add_argument("--laps", type=float, default=2.0, help="times round (default: %(default)g)")
    parser.add_argument("--frame-rate", type=float, default=10.0, metavar="HZ",
                        help="stereo pairs, Hz (default: %(default)g)")
    parser.add_argument("--exposure", type=float, default=0.0, metavar="S",
                        help="s that the shutter is open: motion blur, of pictures a pixel apart (default: 0, none)")
    parser.add_argument("--exposure-drift", type=float, default=0.0, metavar="SHARE",
                        help="how much brighter and darker the pictures become in turns, as a share (default: 0)")
    parser.add_argument("--pixel-noise", type=float, default=2.0, metavar="LEVELS",
                        help="standard deviation of a pixel, grey levels (default: %(default)g)")
    parser.add_argument("--cars", type=int, default=0, metavar="N", help="other cars in the street, moving (default: 0)")
    parser.add_argument("--seed", type=int, default=1, help="of scene and noise (default: %(default)s)")
    parser.add_argument("--quiet", action="store_true", help="no report and no progress bar")
    return parser


def check_options(options):
    """InputError unless the options can be drawn."""
    for name, low, high in (("duration", 5.0, 3600.0), ("laps", 0.01, 1000.0), ("frame_rate", 1.0, 200.0),
                            ("exposure", 0.0, 0.1), ("exposure_drift", 0.0, 0.9), ("pixel_noise", 0.0, 100.0),
                            ("cars", 0, 100), ("seed", 0, 2**31)):
        value = getattr(options, name)
        if not low <= value <= high:
            raise InputError("--%s is %g, allowed: from %g to %g" % (name.replace("_", "-"), value, low, high))
    if options.cars and options.scene != "street":
        raise InputError("--cars is %d, allowed with --scene street only" % options.cars)
    if os.path.lexists(options.output):
        raise InputError("%s: is there already and will not be replaced" % options.output)
    parent = os.path.dirname(os.path.abspath(options.output))
    if not os.path.isdir(parent):
        raise InputError("%s: the directory %s does not exist" % (options.output, parent))


def simulate_pictures(argv):
    """Do what the command line asks; InputError when something is refused. The folder appears whole or not at all."""
    options = make_parser().parse_args(argv)
    check_options(options)
    output = os.path.abspath(options.output)
    part = None
    try:
        part = tempfile.mkdtemp(prefix=".%s." % os.path.basename(output), suffix=".part", dir=os.path.dirname(output))
        write_drive(part, options)
        os.chmod(part, 0o755)
        os.rename(part, output)
    except OSError as reason:
        raise InputError("%s: cannot be written: %s" % (options.output, reason.strerror or reason))
    finally:
        if part:
            shutil.rmtree(part, ignore_errors=True)
    if not options.quiet:
        print("wrote: %s, a %s of %g s" % (options.output, options.scene, options.duration))


def write_drive(folder, options):
    """mav0 with cam0, cam1, imu0 and state_groundtruth_estimate0 below `folder`.

    Returns what was drawn: the rectangles that do not move, the motion, and imu_T_left.
    """
    random = np.random.default_rng(options.seed)
    motion = MOTIONS[options.scene](options.laps, options.duration)
    lens = _make_lens(options.lens)
    cameras = [make_transform(BODY_R_OPTICAL @ so3_exp(turned), CAMERA_IN_IMU + [0, side * 0.5 * BASELINES[options.scene], 0])
               for side, turned in ((1.0, np.zeros(3)), (-1.0, lens.right_turned))]
    base = os.path.join(folder, "mav0")
    _write_imu(base, motion, options, random)
    count = int((options.duration - 1e-9 * FRAME_DELAY) * options.frame_rate)
    stamps = START + FRAME_DELAY + np.rint(1e9 * np.arange(count) / options.frame_rate).astype(np.int64)
    for name, imu_T_cam in zip(("cam0", "cam1"), cameras):
        os.makedirs(os.path.join(base, name, "data"))
        _write(base, name, "sensor.yaml", _camera_yaml(imu_T_cam, lens, options.frame_rate))
        _write(base, name, "data.csv", "#timestamp [ns],filename\n" + "".join("%d,%d.jpg\n" % (s, s) for s in stamps))
    _write_truth(base, motion, stamps)
    return _draw_pictures(base, motion, stamps, cameras, lens, options, random), motion, cameras[0]


def _moments(motion, t, exposure, focal_length):
    """s from t on, of the pictures that make a blurred one: a pixel apart where something is NEAR m away."""
    speed = np.linalg.norm(felt(motion, t)[0]) + np.linalg.norm(velocity(motion, t)) / NEAR  # rad/s
    count = 1 + int(focal_length * speed * exposure)
    return exposure * ((np.arange(count) + 0.5) / count - 0.5)


def _make_lens(name):
    from vi_ekf_slam.simulation.pictures import lens
    return {"pinhole": lens.Pinhole, "radtan": lens.Radtan, "fisheye": lens.Fisheye}[name]()


def _draw_pictures(base, motion, stamps, cameras, lens, options, random):
    import cv2

    from vi_ekf_slam.simulation.pictures.scene import SCENES, Car
    scene = SCENES[options.scene](random)
    cars = [Car(random.uniform(0.3, 6.0), random.choice([-0.25, 0.12]), -3.5 + 7.0 * (k % 2), random)
            for k in range(options.cars)]
    for stamp in tqdm(stamps, desc="pictures", unit="", disable=options.quiet or not sys.stderr.isatty()):
        t = (stamp - START) * 1e-9
        moments = _moments(motion, t, options.exposure, lens.focal_length)
        gain = 1.0 + options.exposure_drift * np.sin(0.7 * t)
        for name, imu_T_cam in zip(("cam0", "cam1"), cameras):
            drawn = [lens.draw(scene + [face for car in cars for face in car.at(t + d)], inverse(motion.pose(t + d) @ imu_T_cam))
                     for d in moments]
            image = drawn[0] if len(drawn) == 1 else np.mean(drawn, axis=0)
            image = gain * image + options.pixel_noise * random.normal(size=image.shape)
            path = os.path.join(base, name, "data", "%d.jpg" % stamp)
            pixels = np.clip(np.rint(image), 0, 255).astype(np.uint8)
            if not cv2.imwrite(path, pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]):
                raise InputError("%s: cannot be written" % path)
    return scene


def _write_imu(base, motion, options, random):
    """Samples with white noise, and biases that walk."""
    count = int(options.duration * NOISE.rate)
    exact = np.array([np.concatenate(felt(motion, k / NOISE.rate)) for k in range(count)])
    white = np.sqrt(NOISE.rate) * np.repeat([NOISE.gyro_density, NOISE.accelerometer_density], 3)
    walk = np.repeat([NOISE.gyro_walk, NOISE.accelerometer_walk], 3) / np.sqrt(NOISE.rate)
    biases = np.repeat(BIAS_SIGMAS, 3) * random.normal(size=6) + np.cumsum(walk * random.normal(size=(count, 6)), axis=0)
    measured = exact + biases + white * random.normal(size=(count, 6))
    lines = ["%d,%s\n" % (START + round(k * 1e9 / NOISE.rate), ",".join("%.9f" % v for v in row))
             for k, row in enumerate(measured)]
    os.makedirs(os.path.join(base, "imu0"))
    _write(base, "imu0", "data.csv", "#timestamp [ns],w_x,w_y,w_z [rad s^-1],a_x,a_y,a_z [m s^-2]\n" + "".join(lines))
    _write(base, "imu0", "sensor.yaml", "sensor_type: imu\n%srate_hz: %g\n%s" % (
        _pose_yaml(np.eye(4)), NOISE.rate, "".join("%s: %.6e\n" % pair for pair in zip(KEYS, NOISE))))


def _write_truth(base, motion, stamps):
    lines = []
    for stamp in stamps:
        t = (stamp - START) * 1e-9
        pose = motion.pose(t)
        x, y, z, w = rotation_to_quaternion(pose[:3, :3])
        numbers = np.concatenate([pose[:3, 3], [w, x, y, z], velocity(motion, t)])
        lines.append("%d,%s\n" % (stamp, ",".join("%.9f" % n for n in numbers)))
    os.makedirs(os.path.join(base, "state_groundtruth_estimate0"))
    _write(base, "state_groundtruth_estimate0", "data.csv",
           "#timestamp [ns],p_x,p_y,p_z [m],q_w,q_x,q_y,q_z,v_x,v_y,v_z [m s^-1]\n" + "".join(lines))


def _camera_yaml(imu_T_cam, lens, rate):
    return ("sensor_type: camera\n%srate_hz: %g\nresolution: [%d, %d]\ncamera_model: pinhole\nintrinsics: [%g, %g, %g, %g]\n"
            "distortion_model: %s\ndistortion_coefficients: [%g, %g, %g, %g]\n"
            % (_pose_yaml(imu_T_cam), rate, *lens.size, *lens.intrinsics[[0, 1, 0, 1], [0, 1, 2, 2]], lens.model,
               *lens.distortion))


def _pose_yaml(pose):
    return "T_BS: {cols: 4, rows: 4, data: [%s]}\n" % ", ".join("%.9g" % v for v in pose.ravel())


def _write(*parts):
    with open(os.path.join(*parts[:-1]), "w", encoding="utf-8") as stream:
        stream.write(parts[-1])
