"""Open bags that may be missing or damaged."""

import contextlib
import os

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
    except Exception as reason:  # on damaged bags rosbag raises whatever comes up: KeyError, struct.error, ...
        raise InputError("%s: cannot be read as a bag: %s" % (path, str(reason) or type(reason).__name__))
