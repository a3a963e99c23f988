"""Loading drives: both editions, and everything that must be refused with a clear word."""

import os
import re
import struct
import zipfile

import numpy as np
import pytest
from conftest import CAM_R_IMU, CAMERA_IN_IMU, drive, npy_header, second_edition

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.dataset.loader import load_dataset


def with_value(key, index, value):
    """The valid drive with one number changed."""
    arrays = drive()
    arrays[key] = np.array(arrays[key], dtype=float)
    arrays[key][index] = value
    return arrays


def test_first_edition_is_read_with_the_extrinsic_repaired(save):
    arrays = drive()
    dataset = load_dataset(save(arrays))
    assert np.array_equal(dataset.stamps, arrays["time_stamps"][0])
    assert np.array_equal(dataset.angular_velocity, arrays["rotational_velocity"])
    assert np.array_equal(dataset.features, arrays["features"])
    assert dataset.baseline == 0.5 and dataset.frames == 8 and dataset.name == "drive"
    assert dataset.extrinsic_key == "cam_T_imu" and dataset.extrinsic_repaired
    # The camera's own position in IMU axes must come out at the camera's origin.
    assert np.allclose(dataset.cam_T_imu @ np.append(CAMERA_IN_IMU, 1.0), [0, 0, 0, 1])
    assert np.allclose(dataset.cam_T_imu[:3, :3], CAM_R_IMU)


def test_extrinsic_given_is_left_alone(save):
    dataset = load_dataset(save(drive()), extrinsic="given")
    assert np.allclose(dataset.cam_T_imu[:3, 3], CAMERA_IN_IMU) and not dataset.extrinsic_repaired


@pytest.mark.parametrize("reading", ["repaired", "given"])
def test_second_edition_needs_no_repair(save, reading):
    dataset = load_dataset(save(second_edition()), extrinsic=reading)
    assert np.allclose(dataset.cam_T_imu @ np.append(CAMERA_IN_IMU, 1.0), [0, 0, 0, 1])
    assert dataset.extrinsic_key == "imu_T_cam" and not dataset.extrinsic_repaired


def test_other_layouts_of_the_same_numbers(save):
    plain = load_dataset(save(drive()))
    arrays = drive()
    arrays["time_stamps"] = arrays["time_stamps"][0]
    arrays["b"] = np.array([[0.5]])
    arrays["features"] = np.asfortranarray(arrays["features"])
    arrays["linear_velocity"] = arrays["linear_velocity"].astype(">f8")
    other = load_dataset(save(arrays, "other.npz"))
    assert np.array_equal(plain.stamps, other.stamps) and plain.baseline == other.baseline
    assert np.array_equal(plain.features, other.features)
    assert np.array_equal(plain.linear_velocity, other.linear_velocity)


def test_compressed_archives_and_integers_are_read(tmp_path):
    path = str(tmp_path / "compressed.npz")
    np.savez_compressed(path, **drive(features=np.full((4, 3, 8), 20, dtype=np.int16)))
    dataset = load_dataset(path)
    assert dataset.features.dtype == np.float64 and dataset.seen.all()


def test_minus_one_marks_unseen(save):
    dataset = load_dataset(save(drive()))
    assert not dataset.seen[0, 3:].any() and dataset.seen[0, :3].all() and dataset.partial == 0


def test_partly_seen_observations_are_rejected_and_counted(save):
    arrays = with_value("features", (2, 5, 4), -1.0)
    arrays["features"][:3, 6, 4] = -1.0
    dataset = load_dataset(save(arrays))
    assert dataset.partial == 2 and not dataset.seen[5:7, 4].any() and dataset.seen[5:7, 3].all()


def test_missing_features_are_an_error_that_shows_the_way_out(save):
    path = save(drive(features=None))
    with pytest.raises(InputError, match="only dead reckoning is possible; --without-features"):
        load_dataset(path)
    dataset = load_dataset(path, without_features=True)
    assert dataset.features is None and dataset.frames == 8 and dataset.cam_T_imu is not None


def test_without_features_the_cameras_are_not_needed(save):
    dataset = load_dataset(save(drive(features=None, K=None, b=None, cam_T_imu=None)), without_features=True)
    assert dataset.cam_T_imu is None and dataset.intrinsics is None


MIRROR = np.diag([1.0, 1.0, -1.0, 1.0])
SCALED = np.diag([1.0, 1.0, 1.01, 1.0])
BAD = {
    "stamps missing": (drive(time_stamps=None), "time_stamps", "missing"),
    "stamps repeat": (with_value("time_stamps", (0, 3), 1317386425.7), "time_stamps", "at index 3"),
    "stamps fall": (with_value("time_stamps", (0, 5), 1317386425.6), "time_stamps", "at index 5"),
    "stamps nan": (with_value("time_stamps", (0, 2), np.nan), "time_stamps", r"nan at index \[2\]"),
    "stamps from zero": (drive(time_stamps=np.arange(8.0)), "time_stamps", "at index 0, allowed: from 1e-9"),
    "stamps too late": (with_value("time_stamps", (0, 7), 2.0**32), "time_stamps", "at index 7"),
    "one stamp": (drive(time_stamps=np.ones(1)), "time_stamps", "T at least 2"),
    "stamps 2 x T": (drive(time_stamps=np.ones((2, 8))), "time_stamps", "allowed: 1 x T"),
    "velocity missing": (drive(linear_velocity=None), "linear_velocity", "missing"),
    "velocity T x 3": (drive(linear_velocity=np.ones((8, 3))), "linear_velocity", "allowed: 3 x 8"),
    "velocity short": (drive(linear_velocity=np.ones((3, 7))), "linear_velocity", "allowed: 3 x 8"),
    "velocity inf": (with_value("linear_velocity", (1, 4), np.inf), "linear_velocity", r"inf at index \[1, 4\]"),
    "velocity huge": (with_value("linear_velocity", (2, 5), 1e308), "linear_velocity",
                      r"is 1e\+308 at index \[2, 5\], allowed: within \+-1000 m/s"),
    "gyro huge": (with_value("rotational_velocity", (0, 1), -1e4), "rotational_velocity", r"within \+-1000 rad/s"),
    "K huge": (with_value("K", (0, 0), 1e308), "K", r"is 1e\+308 at index \[0, 0\], allowed: within \+-1e\+06 px"),
    "b huge": (drive(b=np.float64(1e308)), "b", r"within \+-1000 m"),
    "extrinsic far": (with_value("cam_T_imu", (1, 3), 1e308), "cam_T_imu", r"within \+-10000 m"),
    "longdouble": (drive(rotational_velocity=np.full((3, 8), np.longdouble("1e4000"))), "rotational_velocity", "inf"),
    "gyro missing": (drive(rotational_velocity=None), "angular_velocity", "neither.*the file holds: K, b, cam_T_imu"),
    "gyro twice": (drive(angular_velocity=np.ones((3, 8))), "angular_velocity", "both"),
    "gyro nan": (with_value("rotational_velocity", (2, 0), np.nan), "rotational_velocity", r"nan at index \[2, 0\]"),
    "gyro complex": (drive(rotational_velocity=np.ones((3, 8), complex)), "rotational_velocity", "dtype complex128"),
    "gyro text": (drive(rotational_velocity=np.full((3, 8), "a")), "rotational_velocity", "real numbers"),
    "features 3 x M x T": (drive(features=np.ones((3, 5, 8))), "features", "allowed: 4 x any x 8"),
    "features other T": (drive(features=np.ones((4, 5, 9))), "features", "allowed: 4 x any x 8"),
    "features flat": (drive(features=np.ones((4, 8))), "features", "allowed: 4 x any x 8"),
    "features nan": (with_value("features", (1, 2, 3), np.nan), "features", r"nan at index \[1, 2, 3\]"),
    "features absurd": (with_value("features", (1, 2, 3), 1e7), "features", r"1e\+07 px, allowed: within"),
    "features unseen at 0": (with_value("features", (slice(None), 5, 3), 0.0), "features",
                             "0 0 0 0 px 1 times, first of landmark 5 at index 3 of time_stamps, allowed: -1 -1 -1 -1"),
    "features bool": (drive(features=np.ones((4, 5, 8), bool)), "features", "dtype bool"),
    "K missing": (drive(K=None), "K", "missing"),
    "K 3 x 4": (drive(K=np.ones((3, 4))), "K", "allowed: 3 x 3"),
    "K no focal length": (with_value("K", (0, 0), 0.0), "K", r"\[0, 0\] \(focal length\) is 0"),
    "K negative": (with_value("K", (1, 1), -650.0), "K", r"is -650 px, allowed: finite and above 0"),
    "K skew": (with_value("K", (0, 1), 0.1), "K", r"\(skew\) is 0.1, allowed: 0"),
    "K lower": (with_value("K", (1, 0), 0.2), "K", r"\[1, 0\]"),
    "K transposed": (drive(K=drive()["K"].T), "K", r"\[2, 0\]"),
    "K scaled": (with_value("K", (2, 2), 2.0), "K", r"\[2, 2\] is 2, allowed: 1"),
    "K nan": (with_value("K", (0, 2), np.nan), "K", "nan"),
    "b missing": (drive(b=None), "b", "missing"),
    "b zero": (drive(b=np.float64(0.0)), "b", "is 0 m, allowed: finite and above 0"),
    "b negative": (drive(b=np.float64(-0.5)), "b", "is -0.5 m"),
    "b nan": (drive(b=np.float64("nan")), "b", "is nan m"),
    "b vector": (drive(b=np.ones(2)), "b", "allowed: one number"),
    "extrinsic missing": (drive(cam_T_imu=None), "imu_T_cam", "neither"),
    "extrinsic twice": (drive(imu_T_cam=np.eye(4)), "imu_T_cam", "both"),
    "extrinsic 3 x 4": (drive(cam_T_imu=np.ones((3, 4))), "cam_T_imu", "allowed: 4 x 4"),
    "extrinsic mirrored": (drive(cam_T_imu=MIRROR), "cam_T_imu", "determinant -1"),
    "extrinsic scaled": (drive(cam_T_imu=SCALED), "cam_T_imu", "not a rotation"),
    "extrinsic transposed": (drive(cam_T_imu=drive()["cam_T_imu"].T), "cam_T_imu", "allowed: 0 0 0 1"),
    "extrinsic inf": (with_value("cam_T_imu", (0, 3), np.inf), "cam_T_imu", "inf"),
}


@pytest.mark.parametrize("case", sorted(BAD))
def test_malformed_arrays_are_refused_by_name(save, case):
    arrays, key, message = BAD[case]
    path = save(arrays)
    with pytest.raises(InputError, match=message) as caught:
        load_dataset(path)
    text = str(caught.value)
    assert text.startswith(path) and re.search(r"\b%s\b" % key, text) and "\n" not in text


def test_object_arrays_are_never_unpickled(tmp_path):
    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "sprung"),)

    path = str(tmp_path / "trap.npz")
    np.savez(path, **drive(features=np.array([Trap()], dtype=object)))
    with pytest.raises(InputError, match="features' holds pickled Python objects"):
        load_dataset(path)
    assert not (tmp_path / "sprung").exists()


def save_with_member(tmp_path, key, content, compression=zipfile.ZIP_DEFLATED):
    """A valid drive in which one member's bytes are replaced."""
    path = str(tmp_path / "crafted.npz")
    np.savez(path, **drive(**{key: None}))
    with zipfile.ZipFile(path, "a", compression) as archive:
        archive.writestr(key + ".npy", content)
    return path


def test_a_header_that_promises_terabytes_is_refused(tmp_path):
    path = save_with_member(tmp_path, "features", npy_header((4, 10**7, 10**6)) + bytes(800))
    with pytest.raises(InputError, match="features.*more than the limit of 4096 MB"):
        load_dataset(path)


def test_a_header_that_promises_more_than_the_member_holds_is_refused(tmp_path):
    path = save_with_member(tmp_path, "features", npy_header((4, 1000, 8)) + bytes(800))
    with pytest.raises(InputError, match="promises 256000 bytes of data, the archive holds 800"):
        load_dataset(path)


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path):
    shape = (4, 20000, 8)
    path = save_with_member(tmp_path, "features", npy_header(shape, "|i1") + 640000 * b"\x01")
    assert os.path.getsize(path) < 20000
    with pytest.raises(InputError, match="more than the limit of 4 MB"):  # 5.1 MB as 64-bit floats
        load_dataset(path, max_memory_mb=4)
    with pytest.raises(InputError, match="time_stamps.*limit"):
        load_dataset(path, max_memory_mb=1e-5)
    assert load_dataset(path, max_memory_mb=6).seen.shape == (20000, 8)


def test_the_memory_limit_is_on_all_arrays_together(save):
    path = save(drive())
    need = sum(8 * np.asarray(a).size for a in drive().values()) / 2.0**20
    assert load_dataset(path, max_memory_mb=1.001 * need).frames == 8
    with pytest.raises(InputError, match="limit"):
        load_dataset(path, max_memory_mb=0.999 * need)


@pytest.mark.parametrize("content, message", [
    (b"", "damaged"), (b"not numpy", "magic"), (b"\x93NUMPY\x01\x00\xff\xff{", "ends"),
    (b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**31) + b"{}", "header of 2147483648 bytes"),
    (b"\x93NUMPY\x07\x00\x02\x00{}", "version 7.0"), (npy_header((3,))[:40], "ends"),
    (npy_header((3,)).replace(b"(3,)", b"(-3)"), "damaged"),
], ids=["empty", "text", "cut", "long header", "version", "half a header", "negative"])
def test_damaged_members_are_refused(tmp_path, content, message):
    path = save_with_member(tmp_path, "b", content)
    with pytest.raises(InputError, match="key 'b' is damaged.*" + message if message != "damaged" else "key 'b' is damaged"):
        load_dataset(path)


def test_truncated_archives_are_refused(save):
    path = save(drive())
    whole = open(path, "rb").read()
    for length in (0, 10, len(whole) // 2, len(whole) - 5):
        with open(path, "wb") as stream:
            stream.write(whole[:length])
        with pytest.raises(InputError, match="not a complete .npz"):
            load_dataset(path)


def test_a_flipped_bit_is_noticed(save):
    path = save(drive())
    content = bytearray(open(path, "rb").read())
    at = content.index(np.float64(700.0).tobytes())  # inside K
    content[at + 6] ^= 1
    with open(path, "wb") as stream:
        stream.write(content)
    with pytest.raises(InputError, match="key 'K' is damaged: Bad CRC-32"):
        load_dataset(path)


def test_a_wrong_checksum_is_noticed_in_compressed_members(tmp_path):
    path = str(tmp_path / "compressed.npz")
    np.savez_compressed(path, **drive())
    with zipfile.ZipFile(path) as archive:
        checksum = struct.pack("<L", archive.getinfo("features.npy").CRC)
    content = open(path, "rb").read()
    with open(path, "wb") as stream:
        stream.write(content.replace(checksum, bytes(4)))
    with pytest.raises(InputError, match="key 'features' is damaged: Bad CRC-32"):
        load_dataset(path)


def test_missing_files_directories_and_other_formats_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_dataset(str(tmp_path / "none.npz"))
    with pytest.raises(InputError, match="is a directory"):
        load_dataset(str(tmp_path))
    np.save(str(tmp_path / "one.npy"), np.ones(3))
    with pytest.raises(InputError, match="not a complete .npz"):
        load_dataset(str(tmp_path / "one.npy"))


def test_a_member_twice_is_refused(tmp_path):
    path = str(tmp_path / "twice.npz")
    np.savez(path, **drive())
    with pytest.warns(UserWarning), zipfile.ZipFile(path, "a") as archive:
        archive.writestr("K.npy", b"")
    with pytest.raises(InputError, match="holds 'K.npy' twice"):
        load_dataset(path)
