"""Image files as they lie on the disk: whole or not, and how large, without decoding them."""

import os
import struct

from vi_ekf_slam.common.errors import InputError, unreadable

SUFFIXES = (".png", ".jpg", ".jpeg")
PNG_HEAD, PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
JPEG_HEAD, JPEG_END = b"\xff\xd8", b"\xff\xd9"
# Start-of-frame markers: C4, C8 and CC among them are tables and extensions.
JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def image_size(path):
    """(width, height) of a whole PNG or JPEG file; InputError when it is neither, or cut short."""
    try:
        with open(path, "rb") as stream:
            data = stream.read()
    except OSError as reason:
        raise unreadable(path, reason)
    try:
        if data.startswith(PNG_HEAD) and data.rstrip(b"\0").endswith(PNG_END):
            return struct.unpack(">II", data[16:24])
        if data.startswith(JPEG_HEAD) and data.rstrip(b"\0").endswith(JPEG_END):
            return _jpeg_size(data)
    except (struct.error, IndexError):
        pass
    raise InputError("%s: is damaged, allowed: a whole PNG or JPEG image (it has %d bytes)" % (path, len(data)))


def _jpeg_size(data):
    at = 2
    while data[at] == 0xFF:
        marker, length = data[at + 1], struct.unpack(">H", data[at + 2:at + 4])[0]
        if marker in JPEG_FRAMES:
            height, width = struct.unpack(">HH", data[at + 5:at + 9])
            return width, height
        at += 2 + length
    raise IndexError("no frame")


def list_images(folder):
    """{stem: path} of the images in a folder."""
    try:
        names = sorted(os.listdir(folder))
    except OSError as reason:
        raise unreadable(folder, reason)
    return {os.path.splitext(name)[0]: os.path.join(folder, name) for name in names
            if os.path.splitext(name)[1].lower() in SUFFIXES}


class Faults:
    """Files that are missing, damaged or too many, and rows whose stamps do not increase: an error at the end, or notes where
    they are to be left out."""

    SHOWN = 10  # in a message

    def __init__(self, skip):
        self._skip, self._texts = skip, []

    def add(self, text):
        """One of them."""
        self._texts.append(text)

    def __len__(self):
        return len(self._texts)

    def is_whole(self, path, size):
        """Whether an image can be used; else it is added. size: (width, height) of the calibration."""
        try:
            found = image_size(path)
            if tuple(found) != tuple(size):
                raise InputError("%s: has %d x %d px, allowed: the %d x %d of the calibration" % (path, *found, *size))
        except InputError as reason:
            self.add(str(reason))
            return False
        return True

    def notes(self):
        """Text of what was left out; InputError where nothing is to be left out."""
        if not self._texts:
            return []
        shown = self._texts[:self.SHOWN]
        more = len(self._texts) - len(shown)
        if not self._skip:
            raise InputError("%s%s (--skip-bad leaves them out)"
                             % ("; ".join(shown), "; and %d more" % more if more else ""))
        return ["left out: %s" % text for text in shown] + (["left out: %d more" % more] if more else [])


def whole_pairs(pairs, size, faults):
    """Of (stamp, left path, right path) those whose images are whole and of `size`; InputError when none is."""
    kept = [pair for pair in pairs if all([faults.is_whole(path, size) for path in pair[1:]])]
    if not kept:
        faults.notes()
        raise InputError("holds no stereo pair that can be used")
    return kept
