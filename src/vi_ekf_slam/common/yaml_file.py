"""Text and YAML files from outside."""

import yaml

from vi_ekf_slam.common.errors import InputError, unreadable


def read_text(path, encoding="utf-8"):
    """What a text file holds; InputError names the file and why it cannot be read."""
    try:
        with open(path, encoding=encoding) as stream:
            return stream.read()
    except (OSError, UnicodeDecodeError) as reason:
        raise unreadable(path, reason)


def read_yaml(path):
    """What a YAML file holds, whatever that is; InputError as of read_text.

    The first line `%YAML:1.0`, which OpenCV asks for, is no YAML and is passed over; so is a last `---`, as `rostopic echo` has it.
    """
    text = read_text(path)
    text = text[:text.rindex("---")] if text.rstrip().endswith("\n---") else text
    try:
        return yaml.safe_load("#" + text if text.startswith("%YAML:") else text)
    except yaml.YAMLError as reason:
        raise unreadable(path, reason)


def read_mapping(path, allowed="`key: value` lines"):
    """The mapping that a YAML file holds; InputError as of read_yaml, and where it is none."""
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise InputError("%s: holds no mapping, allowed: %s" % (path, allowed))
    return values


def yaml_number(value):
    """Text of a float with all its digits that every YAML reader takes for a number: YAML 1.1 asks for a point in 1.0e-05."""
    mantissa, e, exponent = repr(float(value)).partition("e")
    return mantissa + (".0" if e and "." not in mantissa else "") + e + exponent
