"""Read numeric arrays from an .npz archive that nobody vouches for.

Nothing is unpickled, and no array is allocated before its header has been checked against the size that the archive
states for the member and against a memory limit. (numpy.load trusts headers: one of 128 bytes can ask for terabytes.)
"""

import io
import lzma
import math
import os
import struct
import zipfile
import zlib

import numpy as np

from vi_ekf_slam.common.errors import InputError, unreadable

MAX_HEADER_BYTES = 65535  # an .npy header has about 100
# What zipfile, the decompressors and numpy's header parser raise on damaged or exotic members.
DAMAGE = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, OSError, ValueError, TypeError,
          RuntimeError, SyntaxError, IndexError)


class NpzReader:
    """An open .npz archive; use it in a `with` statement. Every failure is an InputError that names file and key."""

    def __init__(self, path, max_memory_mb):
        """Open `path`. max_memory_mb: limit on all arrays read together, counted as 64-bit floats."""
        self.path = path
        self._budget = int(max_memory_mb * 1024 * 1024)
        self._max_memory_mb = max_memory_mb
        if os.path.exists(path) and not os.path.isfile(path):  # zipfile reads a device without end to the last of the memory
            raise InputError("%s: is %s, allowed: an .npz file" % (path, "a directory" if os.path.isdir(path) else "no regular file"))
        try:
            self._archive = zipfile.ZipFile(path)
            self._members = {}
            for info in self._archive.infolist():
                if info.filename in self._members:
                    raise InputError("%s: holds %r twice" % (path, info.filename))
                self._members[info.filename] = info
        except FileNotFoundError:
            raise InputError("%s: no such file" % path)
        except zipfile.BadZipFile as reason:
            raise InputError("%s: not a complete .npz (zip) archive: %s" % (path, reason))
        except DAMAGE as reason:
            raise unreadable(path, reason)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._archive.close()

    def keys(self):
        """Names of the arrays, without the members' suffix .npy."""
        return sorted(name[:-4] if name.endswith(".npy") else name for name in self._members)

    def read(self, key):
        """The array of real numbers under `key`, as float64."""
        member = self._members.get(key + ".npy", self._members.get(key))
        if member is None:
            raise InputError("%s: key '%s' is missing; the file holds: %s"
                             % (self.path, key, ", ".join(self.keys()) or "nothing"))
        try:
            with self._archive.open(member) as stream:
                shape, fortran_order, dtype = self._read_header(key, member, stream)
                flat = np.frombuffer(self._read_exactly(stream, math.prod(shape) * dtype.itemsize), dtype=dtype)
                if stream.read(1):  # at the end of a member zipfile compares its checksum
                    raise ValueError("more bytes than the header says")
            flat = flat.reshape(shape, order="F" if fortran_order else "C")
        except DAMAGE as reason:
            # Numpy's reasons may go on for lines, about options that are not ours.
            raise InputError("%s: key '%s' is damaged: %s" % (self.path, key, str(reason).split("\n")[0]))
        with np.errstate(over="ignore"):  # what a 128-bit number leaves infinite, the caller's checks refuse
            return flat.astype(np.float64)

    def _read_header(self, key, member, stream):
        major, minor = np.lib.format.read_magic(stream)
        if (major, minor) not in ((1, 0), (2, 0)):
            raise ValueError("format version %d.%d, allowed: 1.0 and 2.0" % (major, minor))
        length_format = "<H" if major == 1 else "<I"
        length_bytes = self._read_exactly(stream, struct.calcsize(length_format))
        length = struct.unpack(length_format, length_bytes)[0]
        if length > MAX_HEADER_BYTES:
            raise ValueError("header of %d bytes, allowed: at most %d" % (length, MAX_HEADER_BYTES))
        parse = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
        shape, fortran_order, dtype = parse(io.BytesIO(length_bytes + self._read_exactly(stream, length)))

        where = "%s: key '%s'" % (self.path, key)
        if dtype.hasobject:
            raise InputError("%s holds pickled Python objects (dtype object), allowed: real numbers; "
                             "pickles can run code and are never loaded" % where)
        if dtype.kind not in "iuf":
            raise InputError("%s has dtype %s, allowed: real numbers (integer or floating point)" % (where, dtype))
        if any(n < 0 for n in shape):
            raise ValueError("negative dimension in shape %s" % (shape,))
        count = math.prod(shape)
        if 8 * math.prod(max(n, 1) for n in shape) > self._budget:  # an axis of none does not excuse the others
            raise InputError("%s has shape %s, with which the arrays take more than the limit of %g MB "
                             "(--max-memory-mb raises it)" % (where, shape, self._max_memory_mb))
        header_bytes = 6 + 2 + len(length_bytes) + length
        if header_bytes + count * dtype.itemsize != member.file_size:
            raise ValueError("its header promises %d bytes of data, the archive holds %d"
                             % (count * dtype.itemsize, member.file_size - header_bytes))
        self._budget -= 8 * count
        return shape, fortran_order, dtype

    @staticmethod
    def _read_exactly(stream, count):
        data = stream.read(count) if count else b""
        if len(data) != count:
            raise EOFError("it ends %d bytes early" % (count - len(data)))
        return data
