"""Does what a configuration asks for exist? Each check names what is missing and lists what there is."""

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.rviz.config import FRAMES, TRUTH


def check(offer, displays, frames):
    """InputError unless the Offer has every display's topic with its type, and every frame.

    displays: [TopicDisplay]; frames: {'map_frame': name, ...}. Of a drive's measurements only the truth and the IMU's
    frame can be checked, because the rest appears when the node runs.
    Returns one line that says what was checked.
    """
    if offer.is_drive(displays):
        displays = [d for d in displays if d.name == TRUTH]
        frames = {"imu_frame": frames["imu_frame"]}
        scope = "of a drive that is not processed yet: only the IMU's frame and the truth"
    else:
        scope = "%d topics and their types, %d frames" % (len(displays), len(frames))
    for display in displays:
        _check_topic(offer, display)
    for option, frame in frames.items():
        if frame not in offer.frames:
            raise InputError("--%s is '%s': %s has no such frame; it has: %s"
                             % (option.replace("_", "-"), frame, offer.source, _listed(offer.frames)))
    if "map_frame" in frames:
        _check_connections(offer, displays, frames)
    return "checked against %s: %s" % (offer.source, scope)


def _check_topic(offer, display):
    if display.topic not in offer.topics:
        candidates = ["%s (%s)" % (topic, kind) for topic, kind in offer.topics.items() if kind == display.kind]
        raise InputError("display '%s': %s has no topic %s; of its type %s it has: %s; all topics: %s"
                         % (display.name, offer.source, display.topic, display.kind, _listed(candidates),
                            _listed(offer.topics)))
    kind = offer.topics[display.topic]
    if kind != display.kind:
        raise InputError("display '%s': topic %s of %s has the type %s, allowed: %s"
                         % (display.name, display.topic, offer.source, kind, display.kind))


def _check_connections(offer, displays, frames):
    """Whether rviz could draw every frame and topic in the map's frame."""
    world = frames["map_frame"]
    for option in FRAMES:
        if option in frames and not offer.connected(world, frames[option]):
            raise InputError("--%s is '%s': in %s no transform connects it with the frame '%s'"
                             % (option.replace("_", "-"), frames[option], offer.source, world))
    for display in displays:
        frame = offer.headers.get(display.topic)
        if frame is not None and not offer.connected(world, frame):
            raise InputError("display '%s': topic %s of %s is in the frame '%s', which no transform connects with '%s'"
                             % (display.name, display.topic, offer.source, frame, world))


def _listed(names):
    return ", ".join(sorted(names)) or "none"
