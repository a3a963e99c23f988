"""Output files that appear whole or not at all."""

import contextlib
import os
import secrets

from vi_ekf_slam.common.errors import InputError


def check_output(path, source=None, suffix="", name="--output"):
    """InputError unless a file can be put at `path` without harm to anything but an older file of that name.

    source: what it must not replace. suffix: what its name has to end in. name: of the argument that gives it.
    """
    folder = os.path.dirname(path) or "."
    if not os.path.isdir(folder):
        raise InputError("%s: the directory %s does not exist" % (path, folder))
    if os.path.lexists(path) and not os.path.isfile(path):
        raise InputError("%s: is not a regular file and will not be replaced" % path)
    if source is not None and os.path.exists(path) and os.path.exists(source) and os.path.samefile(path, source):
        raise InputError("%s: is the input itself" % path)
    if not path.lower().endswith(suffix):
        raise InputError("%s is %s, allowed: a name that ends in %s" % (name, path, suffix))


@contextlib.contextmanager
def replacing(path):
    """A binary stream whose content replaces `path` when the block ends well, and leaves no trace when it does not."""
    target = os.path.realpath(path)
    part = os.path.join(os.path.dirname(target), ".%s.%s.part" % (os.path.basename(target), secrets.token_hex(4)))
    try:
        with open(part, "x+b") as stream:
            yield stream
        os.replace(part, target)
    except OSError as reason:
        raise InputError("%s: cannot be written: %s" % (path, reason.strerror or reason))
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(part)


def make_directory(path):
    """Make a directory and its parents unless it is there."""
    try:
        os.makedirs(path, exist_ok=True)
    except OSError as reason:
        raise InputError("%s: cannot be made: %s" % (path, reason.strerror))


def write_text(path, text):
    """Check `path` and replace it with the text."""
    check_output(path)
    with replacing(path) as stream:
        stream.write(text.encode("utf-8"))
