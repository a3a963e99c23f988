"""Which bags the player takes, and what of them it plays."""

import pytest
import rosbag
import rospy
from sensor_msgs.msg import CameraInfo, CompressedImage, Imu
from std_msgs.msg import String

from vi_ekf_slam.msg import StereoFeatureArray
from vi_ekf_slam.ros.recorded_bag import PlayError, RecordedBag


@pytest.fixture
def pictures(tmp_path):
    """A bag with nothing but pictures."""
    path = tmp_path / "pictures.bag"
    with rosbag.Bag(str(path), "w") as bag:
        for k in range(1, 4):
            for side in ("left", "right"):
                message = CompressedImage(format="png")
                message.header.stamp = rospy.Time(k)
                bag.write("/%s/image/compressed" % side, message, rospy.Time(k))
    return str(path)


def test_pictures_alone_are_played_to_the_front_end(pictures):
    bag = RecordedBag(pictures, "/slam", 0.0, 0.0, "compressed")
    assert bag.played == ["/left/image/compressed", "/right/image/compressed"] and bag.goal == rospy.Time(3)
    assert bag.duration == 2.0 and bag.imu_frame is None
    with rosbag.Bag(pictures, "a") as more:
        info = CameraInfo()
        info.header.frame_id = "left_camera_optical"
        more.write("/left/camera_info", info, rospy.Time(3))
    assert RecordedBag(pictures, "/slam", 0.0, 0.0, "compressed").imu_frame == "left_camera_optical"


def test_pictures_that_nobody_would_use_are_told_of(pictures):
    with rosbag.Bag(pictures, "a") as bag:
        bag.write("/imu", Imu(), rospy.Time(1))
    assert RecordedBag(pictures, "/slam", 0.0, 0.0).advice == (
        "%s: no /features in it; front_end:=true image_transport:=compressed makes them of /left/image/compressed and "
        "/right/image/compressed" % pictures)
    assert RecordedBag(pictures, "/slam", 0.0, 0.0, "compressed").advice == ""
    with rosbag.Bag(pictures, "a") as bag:
        bag.write("/features", StereoFeatureArray(), rospy.Time(1))
    assert RecordedBag(pictures, "/slam", 0.0, 0.0).advice == ""


def test_pictures_of_which_none_would_go_on_are_refused(pictures):
    assert RecordedBag(pictures, "/slam", 0.0, 0.0, "compressed", 1.9).played
    with pytest.raises(PlayError, match="no /imu in it, for which the front end waits 2 s .* only 2 s of it are played"):
        RecordedBag(pictures, "/slam", 0.0, 0.0, "compressed", 2.0)


def test_pictures_alone_are_refused_without_it(pictures):
    with pytest.raises(PlayError, match="none of /imu, .*; it has /left/image/compressed"):
        RecordedBag(pictures, "/slam", 0.0, 0.0)
    with pytest.raises(PlayError, match="none of /imu, .*, /right/image is in it"):
        RecordedBag(pictures, "/slam", 0.0, 0.0, "raw")


@pytest.mark.parametrize("topic, allowed", [
    ("/left/camera_info", "sensor_msgs/CameraInfo"), ("/velocity", "geometry_msgs/TwistWithCovarianceStamped"),
    ("/features", "vi_ekf_slam/StereoFeatureArray"), ("/tf_static", "tf2_msgs/TFMessage")])
def test_an_input_of_another_type_is_refused(tmp_path, topic, allowed):
    path = str(tmp_path / "drive.bag")
    with rosbag.Bag(path, "w") as bag:
        bag.write("/imu", Imu(), rospy.Time(1))
        bag.write("/foreign", String(), rospy.Time(1))
        bag.write("/right/image", String(), rospy.Time(1))  # not played as images
    assert RecordedBag(path, "/slam", 0.0, 0.0).played == ["/foreign", "/imu", "/right/image"]
    with rosbag.Bag(path, "a") as bag:
        bag.write(topic, String(), rospy.Time(1))
    with pytest.raises(PlayError, match="drive.bag: %s is std_msgs/String, it must be %s" % (topic, allowed)):
        RecordedBag(path, "/slam", 0.0, 0.0)


def test_pictures_of_another_type_are_refused(pictures):
    with rosbag.Bag(pictures, "a") as bag:
        for side in ("left", "right"):
            bag.write("/%s/image" % side, CompressedImage(), rospy.Time(1))
        bag.write("/features", String(), rospy.Time(1))  # made of pictures then
    assert RecordedBag(pictures, "/slam", 0.0, 0.0, "compressed").played
    with pytest.raises(PlayError, match="/left/image is sensor_msgs/CompressedImage, it must be sensor_msgs/Image"):
        RecordedBag(pictures, "/slam", 0.0, 0.0, "raw")


def test_a_message_of_another_definition_is_refused(tmp_path):
    path = str(tmp_path / "drive.bag")
    with rosbag.Bag(path, "w") as bag:
        bag.write("/imu", String(), rospy.Time(1), connection_header={
            "topic": "/imu", "type": Imu._type, "md5sum": String._md5sum, "message_definition": String._full_text})
    with pytest.raises(PlayError, match="/imu is sensor_msgs/Imu, it must be sensor_msgs/Imu as it is defined here"):
        RecordedBag(path, "/slam", 0.0, 0.0)
