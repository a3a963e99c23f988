"""Bags that nobody vouches for: what their chunks unpack to is bounded before rosbag unpacks them.

rosbag goes by nothing that a file states about the size: a bz2 chunk of 100 kB can hold gigabytes.
"""

import bz2
import os

import roslz4

# What a compressed chunk may unpack to: so many bytes, or so many times those in the file. As in bag_reader.cpp.
MAX_UNPACKED_BYTES = 64 * 1024 * 1024
MAX_RATIO = 64
PIECE = 4096  # bytes handed to lz4 at a time: one of them unpacks to at most 1 MB


def require_bounded_chunks(bag, path):
    """ValueError unless each chunk of the open rosbag.Bag is within the file and unpacks to as many bytes as it states,
    which may not be absurdly many."""
    length = os.path.getsize(path)
    with open(path, "rb") as stream:
        for header in bag._chunk_headers.values():
            if header.data_pos + header.compressed_size > length:
                raise ValueError("a chunk goes beyond the end (cut short?)")
            if header.compression not in ("bz2", "lz4"):
                continue
            limit = max(MAX_UNPACKED_BYTES, MAX_RATIO * header.compressed_size)
            if header.uncompressed_size > limit:
                raise ValueError("a chunk unpacks to %d bytes, allowed: at most %d" % (header.uncompressed_size, limit))
            stream.seek(header.data_pos)
            _require_size(header, stream.read(header.compressed_size))


def _require_size(header, packed):
    size = 0
    if header.compression == "bz2":
        size = len(bz2.BZ2Decompressor().decompress(packed, max_length=header.uncompressed_size + 1))
    else:
        decompressor = roslz4.LZ4Decompressor()
        for at in range(0, len(packed), PIECE):
            size += len(decompressor.decompress(packed[at:at + PIECE]))
            if size > header.uncompressed_size:
                break
    if size != header.uncompressed_size:
        raise ValueError("a chunk does not unpack to the %d bytes that it states" % header.uncompressed_size)
