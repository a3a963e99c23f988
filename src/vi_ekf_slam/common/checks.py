"""Checks on arrays and numbers from outside. Each raises an InputError that names the place, the value and what is allowed."""

import numpy as np

from vi_ekf_slam.common.errors import InputError

MAX_FOCAL_LENGTH = 1e6  # px, beyond any camera
MAX_ROS_SECONDS = 2**32  # ros::Time counts seconds in 32 bits


def require_finite(array, name):
    """Every entry finite; names the first that is not, by index."""
    bad = ~np.isfinite(array)
    if bad.any():
        index = tuple(int(i) for i in np.unravel_index(int(np.argmax(bad)), array.shape))
        raise InputError("%s is %g at index %s, allowed: finite numbers" % (name, array[index], list(index)))


def require_within(array, limit, name, unit):
    """No entry's magnitude beyond `limit`: such numbers are faults, and large enough ones overflow what is computed."""
    bad = np.abs(array) > limit
    if bad.any():
        index = tuple(int(i) for i in np.unravel_index(int(np.argmax(bad)), array.shape))
        raise InputError("%s is %g at index %s, allowed: within +-%g %s" % (name, array[index], list(index), limit, unit))


def require_shape(array, shape, name):
    """Exact shape; None in `shape` stands for any length."""
    if array.ndim != len(shape) or any(want not in (None, have) for want, have in zip(shape, array.shape)):
        allowed = " x ".join("any" if n is None else str(n) for n in shape)
        raise InputError("%s has shape %s, allowed: %s" % (name, array.shape, allowed))


def require_stamps(stamps, name, place="at index {}".format):
    """(T,) seconds: finite, positive, representable as a ROS time, and increasing by at least a nanosecond.

    place(k): where the stamp of row k is.
    """
    require_finite(stamps, name)
    outside = ~((stamps >= 1e-9) & (stamps < MAX_ROS_SECONDS))
    if outside.any():
        k = int(np.argmax(outside))
        raise InputError("%s is %.9g s %s, allowed: from 1e-9 to %d" % (name, stamps[k], place(k), MAX_ROS_SECONDS))
    steps = np.diff(nanoseconds(stamps))
    if (steps <= 0).any():
        k = int(np.argmax(steps <= 0)) + 1
        raise InputError("%s is not increasing: %.9f s %s comes after %.9f s" % (name, stamps[k], place(k), stamps[k - 1]))


def nanoseconds(stamps):
    """Seconds (float64) -> integer nanoseconds, rounded; second and remainder apart, so that no digit is lost."""
    whole = np.floor(stamps)
    return whole.astype(np.int64) * 1000000000 + np.rint((stamps - whole) * 1e9).astype(np.int64)


def require_distinct(frames):
    """No frame of a rig twice: a transform between a frame and itself is none."""
    for k, frame in enumerate(frames):
        if frame in frames[:k]:
            raise InputError("two of the frames of IMU, left and right camera are '%s', allowed: three different ones "
                             "(--imu-frame, --left-frame, --right-frame)" % frame)


def require_positive(value, name, unit=""):
    """A finite number above zero, returned as float."""
    if not (np.isfinite(value) and value > 0.0):
        raise InputError("%s is %g%s, allowed: finite and above 0" % (name, value, " " + unit if unit else ""))
    return float(value)


def require_intrinsics(matrix, name):
    """3 x 3 pinhole intrinsics in px: upper triangular, positive focal lengths, no skew, last row 0 0 1."""
    require_shape(matrix, (3, 3), name)
    require_finite(matrix, name)
    require_within(matrix, MAX_FOCAL_LENGTH, name, "px")
    for i in (0, 1):
        require_positive(matrix[i, i], "%s[%d, %d] (focal length)" % (name, i, i), "px")
    for (i, j), what in (((0, 1), "skew"), ((1, 0), "below the diagonal"), ((2, 0), "last row"), ((2, 1), "last row")):
        if matrix[i, j] != 0.0:
            raise InputError("%s[%d, %d] (%s) is %g, allowed: 0" % (name, i, j, what, matrix[i, j]))
    if matrix[2, 2] != 1.0:
        raise InputError("%s[2, 2] is %g, allowed: 1" % (name, matrix[2, 2]))
