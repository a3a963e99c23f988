"""rviz configurations as YAML: the shipped one, which of its entries hold frames and topics, and how to change them."""

import math
from collections import namedtuple

import yaml

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.package_files import package_file
from vi_ekf_slam.common.yaml_file import read_yaml

# rviz class: (key of the topic, its type).
TOPIC_DISPLAYS = {
    "rviz/Path": ("Topic", "nav_msgs/Path"),
    "rviz/PoseWithCovariance": ("Topic", "geometry_msgs/PoseWithCovarianceStamped"),
    "rviz/Odometry": ("Topic", "nav_msgs/Odometry"),
    "rviz/Pose": ("Topic", "geometry_msgs/PoseStamped"),
    "rviz/PointCloud2": ("Topic", "sensor_msgs/PointCloud2"),
    "rviz/Marker": ("Marker Topic", "visualization_msgs/Marker"),
    "rviz/MarkerArray": ("Marker Topic", "visualization_msgs/MarkerArray"),
    "rviz/Image": ("Image Topic", "sensor_msgs/Image"),
}
TRUTH = "Ground truth"  # may be without its topic: most drives have no truth
TRACKS = "Tracks"  # the front end's picture; off until there is one, since it takes a part of the window
# What can be chosen: name of the display in the shipped file.
DISPLAYS = {"path": "Path", "dead_reckoning": "Dead reckoning", "truth": TRUTH, "landmarks": "Landmarks",
            "landmark_cloud": "Landmarks from afar", "pose": "Pose, 3 sigma"}
LANDMARKS = "landmarks"  # namespace of the landmarks' markers
GRID = "Grid (%g m)"
# rviz class: keys of what is a length (m), or in proportion to one.
LENGTHS = {"rviz/TF": ["Marker Scale"], "rviz/Path": ["Line Width"],
           "rviz/PoseWithCovariance": ["Head Length", "Head Radius", "Shaft Length", "Shaft Radius"]}
SMALL = 0.25  # below this scale landmarks, squares of 0.2 m, hide each other; points of so many pixels do not
POINT_PX = 3
FRAMES = {"map_frame": "map", "odom_frame": "odom", "imu_frame": "imu_link"}


TopicDisplay = namedtuple("TopicDisplay", "name topic kind")
TopicDisplay.__doc__ = """A display that is switched on and listens: its name, its topic, the topic's type."""


def shipped_path():
    """Path of the shipped configuration, in the checkout or in the install space."""
    return package_file("rviz", "vi_ekf_slam.rviz")


def load_config(path):
    """A configuration as nested dicts; InputError names the file and what is wrong with it."""
    config = read_yaml(path)
    manager = config.get("Visualization Manager") if isinstance(config, dict) else None
    displays = manager.get("Displays") if isinstance(manager, dict) else None
    if not isinstance(displays, list) or not all(isinstance(d, dict) and "Class" in d for d in displays):
        raise InputError("%s: has no list 'Displays' below 'Visualization Manager', allowed: a file that rviz saved"
                         % path)
    return config


def dump_config(config):
    """The configuration as bytes that rviz reads."""
    return yaml.safe_dump(config, default_flow_style=False, sort_keys=False, allow_unicode=True).encode("utf-8")


def displays_of(config):
    """The list of displays, to be read or changed; those inside groups are not listed one by one."""
    return config["Visualization Manager"]["Displays"]


def topic_displays(config):
    """[TopicDisplay] of the displays that are switched on and whose type is known here."""
    found = []
    for display in displays_of(config):
        key, kind = TOPIC_DISPLAYS.get(display["Class"], (None, None))
        if key is not None and display.get("Enabled", True) and display.get(key):
            found.append(TopicDisplay(str(display.get("Name", display["Class"])), str(display[key]), kind))
    return found


def set_topic(config, name, topic):
    """Give the display of this name another topic, or take it out when the topic is ''."""
    displays = displays_of(config)
    display = next(d for d in displays if d.get("Name") == name)
    if topic:
        display[TOPIC_DISPLAYS[display["Class"]][0]] = topic
    else:
        displays.remove(display)


def switch(config, name, on):
    """Switch the displays of this name on or off."""
    for display in displays_of(config):
        if display.get("Name") == name:
            display["Enabled"] = display["Value"] = on


def set_frame_rate(config, hz):
    """Draw that often, and not more."""
    config["Visualization Manager"].setdefault("Global Options", {})["Frame Rate"] = hz


def set_scale(config, factor):
    """Make all that is drawn `factor` times as large as for a car; below SMALL landmarks are points, not squares."""
    views = config["Visualization Manager"]["Views"]
    for view in [views["Current"]] + (views["Saved"] or []):
        if "Distance" in view:
            view["Distance"] = _rounded(factor * view["Distance"])
            view["Focal Point"] = {axis: _rounded(factor * value) for axis, value in view["Focal Point"].items()}
        if "Scale" in view:
            view["Scale"] = _rounded(view["Scale"] / factor)
    for display in displays_of(config):
        for key in LENGTHS.get(display["Class"], []):
            display[key] = _rounded(factor * display[key])
        if display["Class"] == "rviz/Path":
            display["Offset"] = {axis: _rounded(factor * value) for axis, value in display["Offset"].items()}
        if display["Class"] == "rviz/Grid":
            display["Cell Size"] = cell_size(factor * display["Cell Size"])
            display["Name"] = GRID % display["Cell Size"]
        if factor < SMALL and display["Class"] == "rviz/MarkerArray":
            display["Namespaces"] = {LANDMARKS: False}
        if factor < SMALL and display["Class"] == "rviz/PointCloud2":
            display["Size (Pixels)"] = POINT_PX


def _rounded(value):
    return float("%.9g" % value)


def cell_size(least):
    """The smallest power of ten (m) that is not less."""
    return 10.0 ** math.ceil(math.log10(least) - 1e-9)


def set_frames(config, names):
    """Replace frames of the shipped configuration; names: {frame of the shipped file: frame to use or ''}."""
    manager = config["Visualization Manager"]
    options, views = manager["Global Options"], manager["Views"]
    options["Fixed Frame"] = names.get(options["Fixed Frame"], options["Fixed Frame"])
    for view in [views["Current"]] + (views["Saved"] or []):
        if "Target Frame" in view:
            view["Target Frame"] = names.get(view["Target Frame"], view["Target Frame"])
    for display in displays_of(config):
        if "Reference Frame" in display:
            display["Reference Frame"] = names.get(display["Reference Frame"], display["Reference Frame"])
        if display["Class"] == "rviz/TF" and "Frames" in display:
            frames = {names.get(frame, frame): value for frame, value in display["Frames"].items()}
            display["Frames"] = {frame: value for frame, value in frames.items() if frame}
