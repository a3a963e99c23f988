"""Shared parts of the Python tests. Run after sourcing the devel space: python3 -m pytest test/python

Files have names of their own across the folders, which are no packages.
"""

import contextlib
import functools
import io
import json
import os
import runpy
import shutil
import subprocess
import sys
import traceback
from collections import namedtuple

import numpy as np
import pytest
from scipy.linalg import expm

ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), "..", ".."))
# What takes this long hangs; far from what anything takes, since a busy machine must not fail a test.
HANG_S = 900
DATA = os.environ.get("VI_EKF_SLAM_DATA", os.path.join(ROOT, "..", "shared", "data"))


def pytest_configure(config):
    try:
        import vi_ekf_slam.msg  # noqa: F401
    except ImportError as reason:
        raise pytest.UsageError("%s: build the package and source its devel/setup.bash first" % reason)


def data_file(name):
    """Path of a real drive's file; skips the test, saying how to run it, where the data is not at hand."""
    path = os.path.join(DATA, name)
    if not os.path.isfile(path):
        pytest.skip("NOT RUN: %s is not in %s; set VI_EKF_SLAM_DATA to the directory with the drives" % (name, DATA))
    return path


def se3_exp(xi):
    """Twist times time (v dt, w dt), shape 6 -> transform; the motion of a body with a constant body twist."""
    (x, y, z), (a, b, c) = np.reshape(xi, (2, 3))
    return expm([[0.0, -c, b, x], [c, 0.0, -a, y], [-b, a, 0.0, z], [0.0] * 4])


def dead_reckon(stamps, linear_velocity, angular_velocity):
    """Poses world_T_imu (T, 4, 4) from (T,) s and (3, T) m/s and rad/s, the first the identity: the sample at k held until k + 1."""
    poses = [np.eye(4)]
    for dt, twist in zip(np.diff(stamps), np.vstack([linear_velocity, angular_velocity]).T):
        poses.append(poses[-1] @ se3_exp(dt * twist))
    return np.array(poses)


Ended = namedtuple("Ended", "returncode stdout stderr")


def script(name, *arguments):
    """Run one of the package's scripts to its end; an Ended. Within this interpreter, since most of its time as a process would
    go into imports; test_rosrun.py starts each as a process."""
    argv, out, err = sys.argv, io.StringIO(), io.StringIO()
    sys.argv = [script_path(name)] + [str(a) for a in arguments]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = _run(sys.argv[0])
    finally:
        sys.argv = argv
    return Ended(code, out.getvalue(), err.getvalue())


def _run(path):
    try:
        runpy.run_path(path, run_name="__main__")
    except SystemExit as end:
        return end.code or 0
    except Exception:
        traceback.print_exc()
        return 1
    return 0


def process(name, *arguments, environment=None):
    """The same as a process of its own, the finished subprocess: where its environment or what it imports matters."""
    return subprocess.run([sys.executable, script_path(name)] + [str(a) for a in arguments], env=environment,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, timeout=HANG_S)


@pytest.fixture
def evaluated():
    """Runs run_bag on a bag and evaluate.py on what comes out; returns what evaluation.json holds. `truth`: options of evaluate.py,
    of the bag unless told otherwise."""
    def run(bag, output, *options, truth=None):
        subprocess.run([program("run_bag"), bag, "--output", output, "--quiet", *options], check=True, timeout=HANG_S)
        done = script("evaluate.py", output, *(truth or ("--bag", bag)), "--no-plots")
        assert done.returncode == 0, done.stderr
        with open(os.path.join(output, "evaluation.json"), encoding="utf-8") as stream:
            return json.load(stream)
    return run


def script_path(name):
    return os.path.join(ROOT, "scripts", name)


@functools.lru_cache(maxsize=None)  # looks through all folders of the checkout
def program(name):
    """Path of a program of the package in the workspace that is sourced."""
    from roslib.packages import find_node
    return find_node("vi_ekf_slam", name)[0]  # unlike rosrun it does look below the package's own build folder


# Optical axes (x right, y down, z forward) seen from the IMU's (x forward, y left, z up).
CAM_R_IMU = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
CAMERA_IN_IMU = np.array([1.1, -0.3, 0.7])  # m


def drive(frames=8, landmarks=12, **changes):
    """The arrays of a small valid drive, edition one; a change to None takes a key away."""
    random = np.random.default_rng(7)
    features = random.uniform(10.0, 300.0, (4, landmarks, frames))
    features[:, 0, 3:] = -1.0
    features[:, 1, :2] = -1.0
    arrays = {
        "time_stamps": 1317386425.5 + 0.1 * np.arange(frames)[None, :],
        "linear_velocity": np.vstack([np.full(frames, 5.0), random.normal(size=(2, frames))]),
        "rotational_velocity": 0.1 * random.normal(size=(3, frames)),
        "features": features,
        "K": np.array([[700.0, 0.0, 320.0], [0.0, 650.0, 240.0], [0.0, 0.0, 1.0]]),
        "b": np.float64(0.5),
        "cam_T_imu": np.vstack([np.column_stack([CAM_R_IMU, CAMERA_IN_IMU]), [0, 0, 0, 1]]),
    }
    arrays.update(changes)
    return {key: value for key, value in arrays.items() if value is not None}


def second_edition(**changes):
    """The same drive under the keys angular_velocity and imu_T_cam."""
    arrays = drive(**changes)
    arrays["angular_velocity"] = arrays.pop("rotational_velocity")
    del arrays["cam_T_imu"]
    arrays["imu_T_cam"] = np.vstack([np.column_stack([CAM_R_IMU.T, CAMERA_IN_IMU]), [0, 0, 0, 1]])
    return arrays


def npy_header(shape, dtype="<f8"):
    """The first bytes of an .npy that promises an array of this shape and kind."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": dtype, "fortran_order": False, "shape": shape})
    return stream.getvalue()


@pytest.fixture
def save(tmp_path):
    """Writes arrays as an .npz; returns its path as text."""
    def write(arrays, name="drive.npz"):
        path = str(tmp_path / name)
        np.savez(path, **arrays)
        return path
    return write


FRAMES = "stamp,features,invalid,used,rejected,initialised,removed,landmarks,frame_rejected,nis,nis_dof,update_ms"
LANDMARK_HEADER = "id,x,y,z,xx,xy,xz,yy,yz,zz"
TRUE_POSITIONS = [(5.0 * k, 0.2 * k * k, 0.0) for k in range(8)]


def tum(positions):
    """TUM lines of bodies that do not turn, at the stamps of drive()."""
    return "".join("%.9f %.9f %.9f %.9f 0 0 0 1\n" % (t, *p) for t, p in zip(drive()["time_stamps"][0], positions))


@pytest.fixture
def run(tmp_path):
    return write_run(tmp_path)


def write_run(parent):
    """A run directory `run` whose SLAM is right and whose dead reckoning is bent."""
    folder = parent / "run"
    folder.mkdir()
    (folder / "trajectory.tum").write_text(tum(TRUE_POSITIONS))
    (folder / "dead_reckoning.tum").write_text(tum([(5.0 * k, 0.5 * k * k, 0.0) for k in range(8)]))
    (folder / "landmarks.csv").write_text(
        LANDMARK_HEADER + "\n7,20,5,1,0.04,0,0,0.01,0,0.09\n8,10,-4,0,2,1,0.5,2,0.25,3\n9,5000,0,0,100,0,0,100,0,100\n")
    (folder / "summary.yaml").write_text("estimator: invariant\nframes: 8\n")
    return folder


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path)


def write_bag(folder):
    """The bag of drive() with the truth of `run`."""
    from vi_ekf_slam.bag.converter import main as convert
    npz, truth, path = (str(folder / name) for name in ("drive.npz", "truth.tum", "drive.bag"))
    np.savez(npz, **drive())
    (folder / "truth.tum").write_text(tum(TRUE_POSITIONS))
    assert convert([npz, path, "--quiet", "--truth", truth]) == 0
    return path


@pytest.fixture
def full_run(run):
    """The run with covariances of (0.1 m)^2 and (0.01 rad)^2, and its frames: NIS 9 of 10 dof, k ms for frame k."""
    return fill(run)


def fill(run):
    """What full_run has beyond `run`."""
    from vi_ekf_slam.evaluation.run_io import COVARIANCE_COLUMNS
    stamps, diagonal = drive()["time_stamps"][0], [0.01] * 3 + [0.0001] * 3
    row = ",".join("%g" % v for v in np.diag(diagonal)[np.triu_indices(6)])
    (run / "covariance.csv").write_text(
        "stamp," + ",".join(COVARIANCE_COLUMNS) + "\n" + "".join("%.9f,%s\n" % (t, row) for t in stamps))
    (run / "frames.csv").write_text(
        FRAMES + "\n" + "".join("%.9f,12,0,10,2,0,0,12,%d,9,10,%d\n" % (t, k == 5, k) for k, t in enumerate(stamps)))
    return run


@pytest.fixture(scope="module")
def drawn_once(tmp_path_factory):
    """What `drawn` copies, since drawing is slow: (folder, Ended of one run, Ended of two). In the folder are `run`, full_run
    evaluated with the bag, and `out`, that run and its trajectory alone side by side."""
    folder = tmp_path_factory.mktemp("drawn")
    bag = write_bag(folder)
    run = fill(write_run(folder))
    both = [run, run / "trajectory.tum", "--name", "first", "--name", "second", "--output", folder / "out"]
    return folder, script("evaluate.py", run, "--bag", bag), script("evaluate.py", *both, "--bag", bag)


@pytest.fixture
def drawn(drawn_once, tmp_path):
    """(run, out, Ended of one run, Ended of two) of drawn_once; the folders are the caller's own."""
    folder, one, two = drawn_once
    for name in ("run", "out"):
        shutil.copytree(str(folder / name), str(tmp_path / name))
    return tmp_path / "run", tmp_path / "out", one, two


def is_png(path):
    return open(str(path), "rb").read(8) == b"\x89PNG\r\n\x1a\n"
