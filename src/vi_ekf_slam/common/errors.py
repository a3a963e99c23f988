"""The one exception by which this package refuses an input."""


class InputError(Exception):
    """A file, value or option is refused. The message names what is wrong, its value and what is allowed."""


def unreadable(path, reason):
    """The InputError, on one line, for a file that an exception says cannot be read."""
    return InputError("%s: cannot be read: %s" % (path, getattr(reason, "strerror", None) or " ".join(str(reason).split())))
