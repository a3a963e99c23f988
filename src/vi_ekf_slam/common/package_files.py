"""What comes with the package: configurations for the estimator and for rviz, and its programs."""

import functools
import os

from vi_ekf_slam.common.errors import InputError


def package_file(*parts):
    """Path of a shipped file, in the checkout or in the install space. parts: below the package's folder."""
    from roslib.packages import InvalidROSPkgException, get_pkg_dir  # needs ROS, which --help does not
    try:
        return os.path.join(get_pkg_dir("vi_ekf_slam"), *parts)
    except InvalidROSPkgException as reason:
        raise InputError("%s; source the workspace's setup.bash" % reason)


@functools.lru_cache(maxsize=None)  # to find it is to look through all folders of the package
def package_program(name):
    """Path of one of the package's programs in the workspace that is sourced."""
    try:
        from roslib.packages import ROSPkgException, find_node
    except ImportError as reason:
        raise InputError("%s; source the workspace's setup.bash" % reason)
    try:
        paths = find_node("vi_ekf_slam", name)
    except ROSPkgException:
        paths = []
    if not paths:
        raise InputError("%s is not found; build the package and source the workspace's setup.bash" % name)
    return paths[0]
