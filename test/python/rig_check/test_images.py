"""Pictures of a bag, as check_rig.py looks at them."""

from types import SimpleNamespace

import genpy
import numpy as np
import pytest
import rosbag
from sensor_msgs.msg import CompressedImage, Image

from vi_ekf_slam.rig_check.images import _decode, read_pairs


def test_deep_pictures_of_a_bag_are_scaled_alike(tmp_path):
    """12 bits in 16: one that just reaches the next bit is not half as bright as the other."""
    levels = {"/left": (2040, 2040, 2050), "/right": (2050, 2040, 2040)}
    path, stamps = str(tmp_path / "deep.bag"), np.arange(3) * 10**8 + 10**9
    with rosbag.Bag(path, "w") as bag:
        for k, stamp in enumerate(stamps):
            for topic, brightest in levels.items():
                message = Image(height=4, width=6, encoding="mono16", step=12)
                message.header.stamp = genpy.Time(*divmod(int(stamp), 10**9))
                message.data = np.full((4, 6), brightest[k], "<u2").tobytes()
                bag.write(topic, message, message.header.stamp)
    streams = {"%s_image" % topic[1:]: SimpleNamespace(topic=topic, stamps=stamps, received=stamps) for topic in levels}
    rig = SimpleNamespace(path=path, streams=streams)
    pairs = list(read_pairs(rig, np.column_stack([np.arange(3)] * 2)))
    assert [(k, int(left.max()), int(right.max())) for k, left, right in pairs] == [(0, 127, 128), (1, 127, 127), (2, 128, 127)]
    assert all(picture.dtype == np.uint8 and picture.shape == (4, 6) for pair in pairs for picture in pair[1:])


def test_what_cannot_be_decompressed_is_no_picture():
    header_of_a_vast_png = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + b"\x7f\xff\xff\xff" * 2 + b"\x08\x00\x00\x00\x00" + b"\x00" * 20
    for data in (b"", b"nothing", header_of_a_vast_png):
        assert _decode(CompressedImage(format="png", data=data)) is None


@pytest.mark.parametrize("encoding", ["yuv422", "yuv422_yuy2"])
def test_a_webcams_yuv_is_read_as_its_grey(encoding):
    """As the front end does: U Y V Y, and Y U Y V."""
    grey = np.arange(48, dtype=np.uint8).reshape(6, 8)
    parts = [np.full_like(grey, 128), grey]
    message = Image(height=6, width=8, encoding=encoding, step=16, data=np.dstack(parts if encoding == "yuv422" else parts[::-1]).tobytes())
    assert (_decode(message) == grey).all()


@pytest.mark.parametrize("name", ["mono", "bgr", "rgb", "bgra", "rgba", "bayer_rggb", "bayer_bggr", "bayer_gbrg", "bayer_grbg"])
@pytest.mark.parametrize("bits", [8, 16])
def test_all_is_read_that_the_front_end_reads(name, bits):
    """Of one grey: each as that grey."""
    channels = {"bgr": 3, "rgb": 3, "bgra": 4, "rgba": 4}.get(name, 1)
    data = np.full((6, 8 * channels), 200, "<u%d" % (bits // 8))
    grey = _decode(Image(height=6, width=8, encoding="%s%d" % (name, bits), step=data.strides[0], data=data.tobytes()))
    assert grey.shape == (6, 8) and grey.dtype == data.dtype and (np.abs(grey.astype(int) - 200) <= 1).all()


def test_what_the_front_end_refuses_is_not_read():
    assert _decode(Image(height=6, width=8, encoding="8UC3", step=24, data=bytes(144))) is None
