"""Which bags the player takes, and what of them it plays."""

import pytest
import rosbag
import rospy
from sensor_msgs.msg import CompressedImage

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


def test_pictures_of_which_none_would_go_on_are_refused(pictures):
    assert RecordedBag(pictures, "/slam", 0.0, 0.0, "compressed", 1.9).played
    with pytest.raises(PlayError, match="no /imu in it, for which the front end waits 2 s .* only 2 s of it are played"):
        RecordedBag(pictures, "/slam", 0.0, 0.0, "compressed", 2.0)


def test_pictures_alone_are_refused_without_it(pictures):
    with pytest.raises(PlayError, match="none of /imu, .*; it has /left/image/compressed"):
        RecordedBag(pictures, "/slam", 0.0, 0.0)
    with pytest.raises(PlayError, match="none of /imu, .*, /right/image is in it"):
        RecordedBag(pictures, "/slam", 0.0, 0.0, "raw")
