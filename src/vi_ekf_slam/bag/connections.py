"""Headers of a bag's connections."""

STATIC_TOPIC = "/tf_static"
_STORED = ("topic", "type", "md5sum", "message_definition", "callerid", "latching")


def latched(topic, message):
    """What rosbag writes by itself, and the flag that makes `rosbag play` latch the topic."""
    return {"topic": topic, "type": message._type, "md5sum": message._md5sum,
            "message_definition": message._full_text, "latching": "1"}


def stored(header):
    """The fields of a live connection's header that belong into a bag."""
    return {name: header[name] for name in _STORED if name in header}
