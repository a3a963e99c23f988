"""The one exception by which this package refuses an input."""


class InputError(Exception):
    """A file, value or option is refused. The message names what is wrong, its value and what is allowed."""
