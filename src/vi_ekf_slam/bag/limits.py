"""Bags that nobody vouches for: what their chunks unpack to is bounded before rosbag unpacks them.

rosbag goes by nothing that a file states about the size: a bz2 chunk of 100 kB can hold gigabytes.
"""

import bz2

import roslz4

MAX_CHUNK_BYTES = 64 * 1024 * 1024  # as in bag_structure.cpp; rosbag writes 768 KiB and at least one message
PIECE = 4096  # bytes handed to lz4 at a time: one of them unpacks to at most 1 MB


def require_small_chunks(bag, path):
    """ValueError unless each chunk of the open rosbag.Bag unpacks to as many bytes as it states, and those are few."""
    with open(path, "rb") as stream:
        for header in bag._chunk_headers.values():
            if max(header.compressed_size, header.uncompressed_size) > MAX_CHUNK_BYTES:
                raise ValueError("a chunk unpacks to %d bytes, allowed: at most %d"
                                 % (max(header.compressed_size, header.uncompressed_size), MAX_CHUNK_BYTES))
            if header.compression in ("bz2", "lz4"):
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
