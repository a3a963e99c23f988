"""Calibration by two files of ROS's camera_calibration, or by two messages: what is read, turned and refused."""

import numpy as np
import pytest
import rospy
import yaml
from folders import asl_folder, assert_same_rig

from vi_ekf_slam.bag.messages import camera_info
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse, so3_exp
from vi_ekf_slam.recordings.rig_calibration import read_calibration


def ros_yaml(camera):
    """A recording.Camera as ROS's camera_calibration writes it."""
    def matrix(array):
        return {"rows": int(np.atleast_2d(array).shape[0]), "cols": int(np.atleast_2d(array).shape[1]),
                "data": [float(v) for v in np.ravel(array)]}
    return yaml.safe_dump({
        "image_width": camera.size[0], "image_height": camera.size[1], "camera_name": "a", "distortion_model": camera.model,
        "camera_matrix": matrix(camera.intrinsics), "distortion_coefficients": matrix(camera.distortion),
        "rectification_matrix": matrix(camera.rectification), "projection_matrix": matrix(camera.projection)})


def info_yaml(camera):
    """A recording.Camera as `rostopic echo -n1 CAMERA_INFO` writes it."""
    return str(camera_info(rospy.Time(1), "a_camera", camera)) + "\n---\n"


@pytest.fixture
def rig(tmp_path):
    """The calibration of asl_folder, and the folder."""
    return read_calibration([str(asl_folder(tmp_path / "euroc"))]), tmp_path


def read_two(rig, folder, cameras, text=ros_yaml):
    """RigCalibration of left.yaml and right.yaml with these cameras, mounted as that of the rig."""
    files, where = [str(folder / name) for name in ("left.yaml", "right.yaml")], folder / "where.yaml"
    where.write_text(yaml.safe_dump({"imu_T_left": np.ravel(rig.imu_T_left).tolist()}))
    for path, camera in zip(files, cameras):
        with open(path, "w") as file:
            file.write(text(camera))
    return read_calibration(files, None, str(where))


def test_camera_calibration_says_the_same_with_the_extrinsic(rig):
    rig, folder = rig
    for name, camera in (("left.yaml", rig.left), ("right.yaml", rig.right)):
        (folder / name).write_text(ros_yaml(camera))
    files = [str(folder / name) for name in ("left.yaml", "right.yaml")]
    with pytest.raises(InputError, match="--imu-T-left"):
        read_calibration(files)
    where = folder / "where.yaml"
    for key, value in (("imu_T_left", rig.imu_T_left), ("T_cam_imu", inverse(rig.imu_T_left)),
                       ("T_BS", rig.imu_T_left)):
        where.write_text(yaml.safe_dump({key: np.ravel(value).tolist()}))
        assert_same_rig(read_calibration(files, None, str(where)), rig)
    with pytest.raises(InputError, match="baseline of projection_matrix"):
        read_calibration(files[::-1], None, str(where))


@pytest.mark.parametrize("text", [ros_yaml, info_yaml])
@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["below", "above"])
def test_two_files_of_cameras_one_above_the_other_are_turned_side_by_side(rig, text, sign):
    """With R and P of what is read a point is in one row, b f / z further left on the right, where the raw cameras see it."""
    rig, folder = rig
    K = np.array([[52.0, 0, 30.0], [0, 50.0, 25.0], [0, 0, 1]])
    shift = np.array([0.0, -0.1 * sign, 0.0])  # right_T_left of the rectified pair
    cameras = [rig.left._replace(projection=np.column_stack([K, K @ t])) for t in (np.zeros(3), shift)]
    cameras[1] = cameras[1]._replace(rectification=rig.right.rectification @ so3_exp([0.01, -0.02, 0.03]))
    found = read_two(rig, folder, cameras, text)
    left, right = found.left, found.right
    assert (right.projection[:, :3] == left.projection[:, :3]).all() and (left.projection[:, 3] == 0.0).all()
    assert -right.projection[:, 3] / right.projection[0, 0] == pytest.approx([0.1, 0.0, 0.0])
    assert left.size == rig.left.size and left.intrinsics == pytest.approx(cameras[0].intrinsics)
    point = np.array([0.3, -0.2, 2.0])  # of the rectified left camera, as it was
    pixels = []
    for was, now, t in ((cameras[0], left, np.zeros(3)), (cameras[1], right, shift)):
        seen = now.projection[:, :3] @ now.rectification @ was.rectification.T @ (point + t)
        pixels.append(seen[:2] / seen[2])
    assert pixels[0] - pixels[1] == pytest.approx([0.1 * 50.0 / 2.0, 0.0])
    in_right = inverse(found.left_T_right) @ np.append(cameras[0].rectification.T @ point, 1.0)
    assert in_right[:3] == pytest.approx(cameras[1].rectification.T @ (point + shift))


def test_two_files_of_camera_calibration_must_be_of_one_pair(rig):
    """Both sides of a rectified pair share fx, fy, cx, cy."""
    rig, folder = rig
    files, where = [str(folder / name) for name in ("left.yaml", "right.yaml")], folder / "where.yaml"
    where.write_text(yaml.safe_dump({"imu_T_left": np.ravel(rig.imu_T_left).tolist()}))
    (folder / "left.yaml").write_text(ros_yaml(rig.left))
    for place, name in (((0, 0), "fx"), ((1, 1), "fy"), ((0, 2), "cx"), ((1, 2), "cy")):
        projection = rig.right.projection.copy()
        projection[place] += 0.01
        (folder / "right.yaml").write_text(ros_yaml(rig.right._replace(projection=projection)))
        with pytest.raises(InputError, match="right.yaml: %s of projection_matrix is .* px, that of .*left.yaml" % name):
            read_calibration(files, None, str(where))


@pytest.mark.parametrize("side, column, message", [
    ("left", [-5.0, 0, 0], "left.yaml: the last column of projection_matrix is not 0"),
    ("right", [-5.0, -1.0, 0], "right.yaml: projection_matrix has a baseline of 0.1 m and 0.02 m across it, allowed: 0.01 of it")])
def test_two_files_with_a_baseline_that_the_node_refuses_are_refused(rig, side, column, message):
    rig, folder = rig
    K = np.array([[50.0, 0, 30.0], [0, 50.0, 25.0], [0, 0, 1]])
    columns = dict({"left": [0.0] * 3, "right": [-5.0, 0, 0]}, **{side: column})
    with pytest.raises(InputError, match=message):
        read_two(rig, folder, [rig.left._replace(projection=np.column_stack([K, columns[name]])) for name in ("left", "right")])


def test_messages_of_rectified_pictures_may_leave_out_D_and_R(rig):
    rig, folder = rig
    bare = [camera._replace(model="", distortion=np.zeros(0), rectification=np.zeros((3, 3))) for camera in (rig.left, rig.right)]
    found = read_two(rig, folder, bare, info_yaml)
    assert found.left.model == "plumb_bob" and (found.left.distortion == 0.0).all() and (found.right.rectification == np.eye(3)).all()


def test_a_fisheye_may_have_zeros_too_many(rig):
    rig, folder = rig
    D = np.array([0.01, 0.02, 0.03, 0.04, 0.0])
    assert read_two(rig, folder, [rig.left._replace(model="equidistant", distortion=D), rig.right]).left.distortion.tolist() == D[:4].tolist()
    with pytest.raises(InputError, match="left.yaml: distortion_coefficients has 5 numbers, allowed with equidistant: 4"):
        read_two(rig, folder, [rig.left._replace(model="equidistant", distortion=D + 0.01), rig.right])


@pytest.mark.parametrize("model, count", [("plumb_bob", 8), ("rational_polynomial", 5), ("rational_polynomial", 8), ("rational_polynomial", 12),
                                          ("rational_polynomial", 14)])
def test_camera_calibration_may_have_the_coefficients_that_the_node_takes(rig, model, count):
    rig, folder = rig
    cameras = [camera._replace(model=model, distortion=np.full(count, 0.01)) for camera in (rig.left, rig.right)]
    assert read_two(rig, folder, cameras).right.distortion.size == count
