"""Files that come with the package: configurations for the estimator and for rviz."""

import os

from vi_ekf_slam.common.errors import InputError


def package_file(*parts):
    """Path of a shipped file, in the checkout or in the install space. parts: below the package's folder."""
    from roslib.packages import InvalidROSPkgException, get_pkg_dir  # needs ROS, which --help does not
    try:
        return os.path.join(get_pkg_dir("vi_ekf_slam"), *parts)
    except InvalidROSPkgException as reason:
        raise InputError("%s; source the workspace's setup.bash" % reason)
