"""Pose files and what becomes of them."""

import numpy as np
import pytest

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse, make_transform, so3_exp
from vi_ekf_slam.dataset.pose_files import read_pose_file, read_tum
from vi_ekf_slam.dataset.truth import load_truth, sample_poses

STAMPS = 100.0 + 0.1 * np.arange(5)
CAM_T_IMU = make_transform(so3_exp([0.3, -1.0, 0.5]), [0.1, -0.7, -1.2])
IDENTITY_ROW = "1 0 0 0 0 1 0 0 0 0 1 0"


@pytest.fixture
def write(tmp_path):
    def run(*lines):
        path = tmp_path / "truth.txt"
        path.write_text("\n".join(lines) + "\n")
        return str(path)
    return run


def tum_line(stamp, position, quaternion=(0, 0, 0, 1)):
    return " ".join("%.12g" % v for v in (stamp, *position, *quaternion))


def test_formats_are_told_apart_by_their_columns(write):
    stamps, poses = read_pose_file(write(IDENTITY_ROW, "", "# remark", IDENTITY_ROW))
    assert stamps is None and np.array_equal(poses, [np.eye(4)] * 2)
    stamps, poses = read_pose_file(write(tum_line(3.5, (1, 2, 3), (0, 0, np.sqrt(0.5), np.sqrt(0.5)))))
    assert list(stamps) == [3.5]
    assert np.allclose(poses[0], [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


@pytest.mark.parametrize("lines, message", [
    (["1 2 3"], "line 1 has 3 columns, allowed: 12 or 8"),
    ([IDENTITY_ROW, "1 0 0"], "line 2 has 3 columns, allowed: 12"),
    ([IDENTITY_ROW.replace("1", "x", 1)], "line 1 holds 'x'"),
    ([IDENTITY_ROW, IDENTITY_ROW.replace("0", "nan", 1)], "line 2 holds 'nan'"),
    ([IDENTITY_ROW, "1 0 0 0 0 1 0 0 0 0 -1 0"], "line 2 is not a pose.*determinant -1"),
    (["2 0 0 0 0 1 0 0 0 0 1 0"], "line 1 is not a pose"),
    ([tum_line(1, (0, 0, 0), (0, 0, 0, 0.9))], "line 1 has a quaternion of norm 0.9"),
    ([tum_line(1, (0, 0, 0)), tum_line(1, (0, 0, 0))], "not increasing"),
    (["# nothing"], "holds no pose"),
    (["#timestamp, p_x", "1403636580838555648,4.688,-1.786,0.783,0.534,-0.153,-0.827,-0.082"], "line 2 has commas, .*_to_bag.py"),
])
def test_malformed_files_are_refused(write, lines, message):
    path = write(*lines)
    with pytest.raises(InputError, match=message) as caught:
        read_pose_file(path)
    assert str(caught.value).startswith(path)


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_pose_file(str(tmp_path / "none"))
    with pytest.raises(InputError, match="is a directory"):
        read_pose_file(str(tmp_path))
    (tmp_path / "binary").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="not a text file"):
        read_pose_file(str(tmp_path / "binary"))


@pytest.mark.parametrize("head", ["\ufeff", "# Wahrheit f\u00fcr 0027\n", "\ufeff# t x y z\n"])
def test_text_of_other_editors_is_read(tmp_path, head):
    path = tmp_path / "truth.tum"
    path.write_text(head + tum_line(3.5, (1, 2, 3)) + "\n", encoding="utf-8")
    assert list(read_pose_file(str(path))[0]) == [3.5]


def test_read_tum_refuses_kitti(write):
    with pytest.raises(InputError, match="12 columns"):
        read_tum(write(IDENTITY_ROW))


def test_more_rows_than_frames_are_refused(write):
    path = write(*[IDENTITY_ROW] * 6)
    with pytest.raises(InputError, match="6 rows, allowed: at most the 5 frames"):
        load_truth(path, STAMPS, CAM_T_IMU)


def test_kitti_truth_need_not_begin_at_the_identity(write):
    offset = make_transform(so3_exp([0, 0.4, 0]), [5.0, 6.0, 7.0])
    step = make_transform(so3_exp([0, 0.1, 0]), [0.0, 0.0, 1.0])
    rows = [" ".join(repr(float(v)) for v in p[:3].ravel()) for p in (offset, offset @ step)]
    stamps, poses = load_truth(write(*rows), STAMPS, CAM_T_IMU)
    assert np.array_equal(stamps, STAMPS[:2]) and np.allclose(poses[0], np.eye(4))
    assert np.allclose(poses[1], inverse(CAM_T_IMU) @ step @ CAM_T_IMU)


def test_kitti_truth_without_upwards_is_refused_with_the_ways_out(write):
    with pytest.raises(InputError, match="does not say where upwards is, allowed: a TUM file, .*evaluate.py --gauge pose"):
        load_truth(write(IDENTITY_ROW), STAMPS, CAM_T_IMU, anchored=False)


def test_tum_poses_are_the_imus_unless_said_otherwise(write):
    path = write(tum_line(100.0, (1, 1, 1)), tum_line(100.05, (3, 1, 1)))
    stamps, poses = load_truth(path, STAMPS, None)
    assert np.allclose(stamps, [100.0, 100.05]) and np.allclose(poses[1], make_transform(np.eye(3), [2, 0, 0]))
    _, poses = load_truth(path, STAMPS, CAM_T_IMU, body="left_camera")
    assert np.allclose(poses[1], inverse(CAM_T_IMU) @ make_transform(np.eye(3), [2, 0, 0]) @ CAM_T_IMU)
    with pytest.raises(InputError, match="no extrinsic"):
        load_truth(path, STAMPS, None, body="left_camera")


def test_a_stamp_that_does_not_increase_is_named_by_its_line(write):
    path = write("# stamp ...", tum_line(100.2, (0, 0, 0)), tum_line(100.1, (0, 0, 0)))
    with pytest.raises(InputError, match="stamp is not increasing: 100.100000000 s in line 3 comes after"):
        load_truth(path, STAMPS, None)


def test_tum_poses_outside_the_drive_are_left_out(write):
    path = write(*[tum_line(t, (t, 0, 0)) for t in (99.0, 100.1, 100.2, 101.0)])
    stamps, poses = load_truth(path, STAMPS, None)
    assert np.allclose(stamps, [100.1, 100.2]) and np.allclose(poses[1][0, 3], 0.1)
    with pytest.raises(InputError, match="do not meet"):
        load_truth(path, STAMPS + 50.0, None)


def test_truth_of_once_a_second_whose_stamps_jitter_is_interpolated():
    stamps = np.array([0.0, 1.005, 1.998])
    poses = np.array([make_transform(np.eye(3), [t, 0, 0]) for t in stamps])
    valid, sampled = sample_poses(stamps, poses, np.array([0.5, 1.5]))
    assert valid.all() and np.allclose(sampled[:, 0, 3], [0.5, 1.5])


def test_sampling_interpolates_and_never_extrapolates_or_bridges_gaps():
    stamps = np.array([0.0, 1.0, 5.0])
    poses = np.array([make_transform(so3_exp([0, 0, 0.4 * t]), [10.0 * t, 0, 0]) for t in stamps])
    valid, sampled = sample_poses(stamps, poses, np.array([-0.1, 0.0, 0.25, 1.00005, 3.0, 5.0, 5.1]))
    assert list(valid) == [False, True, True, True, False, True, False]
    assert np.allclose(sampled[:, 0, 3], [0.0, 2.5, 10.0, 50.0])
    assert np.array_equal(sampled[0], poses[0]) and np.allclose(sampled[1, :3, :3], so3_exp([0, 0, 0.1]))
