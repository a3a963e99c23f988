"""Open bags that may be missing or damaged, and read no more of their messages than is needed."""

import contextlib
import os
import struct

from vi_ekf_slam.common.errors import InputError


@contextlib.contextmanager
def open_bag(path):
    """The rosbag.Bag while the block lasts, which only reads it: whatever it raises becomes an InputError with the path."""
    import rosbag  # needs ROS, which --help does not
    if not os.path.isfile(path):
        raise InputError("%s: no such file" % path)
    try:
        with rosbag.Bag(path) as bag:
            yield bag
    except InputError:
        raise
    except Exception as reason:  # on damaged bags rosbag raises whatever comes up: KeyError, struct.error, ...
        raise InputError("%s: cannot be read as a bag: %s" % (path, str(reason) or type(reason).__name__))


def read_header(data):
    """(stamp ns, frame_id) of a serialised message that begins with a std_msgs/Header; the rest is not unpacked, which takes long."""
    _, seconds, nanoseconds, length = struct.unpack_from("<4I", data)
    return seconds * 10**9 + nanoseconds, data[16:16 + length].decode(errors="replace")


def content(data):
    """What follows the std_msgs/Header of a serialised message, as a memoryview."""
    return memoryview(data)[16 + struct.unpack_from("<I", data, 12)[0]:]
