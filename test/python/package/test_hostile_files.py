"""Files made to harm: refused in one line, without output, and within a bounded address space (RLIMIT_AS)."""

import bz2
import os
import re
import resource
import struct
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from conftest import HANG_S, drive, npy_header, program, script_path

from vi_ekf_slam.bag.messages import LEFT_FRAME

MEGABYTE = 1024 * 1024
LIMIT = 1024 * MEGABYTE  # an interpreter with numpy, rosbag and their libraries has mapped about half of it
CONFIG = os.path.join(os.path.dirname(script_path("")), "..", "config", "default.yaml")


def limited(command, stdin=None, limit=LIMIT):
    """The finished process of `command`, whose address space was limited."""
    environment = dict(os.environ, OPENBLAS_NUM_THREADS="1", MALLOC_ARENA_MAX="1")
    return subprocess.run([str(part) for part in command], stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          universal_newlines=True, timeout=HANG_S, env=environment,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)))


def expect_refusal(done, *words):
    """Status 2, one line with all words on stderr, nothing on stdout."""
    lines = done.stderr.splitlines()
    assert done.returncode == 2 and len(lines) == 1, (done.returncode, done.stderr[:2000])
    for word in words:
        assert str(word) in lines[0]
    assert done.stdout == ""


# The converter.

def convert(source, *options):
    output = os.path.join(os.path.dirname(source), "out.bag")
    return limited([sys.executable, script_path("dataset_to_bag.py"), source, output] + list(options))


def crafted(tmp_path, key, pieces, name=None):
    """A valid drive whose member `key` has the bytes of `pieces`, deflated."""
    path = str(tmp_path / "crafted.npz")
    np.savez(path, **drive(**{key: None}))
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with archive.open(name or key + ".npy", "w", force_zip64=True) as member:
            for piece in pieces:
                member.write(piece)
    return path


def test_the_limit_leaves_room_for_an_honest_drive(save, tmp_path):
    done = convert(save(drive()))
    assert done.returncode == 0, done.stderr
    assert sorted(os.listdir(str(tmp_path))) == ["drive.npz", "out.bag"]


def zeros(megabytes):
    return (bytes(MEGABYTE) for _ in range(megabytes))


NPZ = {
    # 1 GB of zeros in 5 MB.
    "bomb behind a header": ("features", lambda: [npy_header((4, 12, 8)), *zeros(1024)], ["features", "promises 3072 bytes"]),
    "gigantic shape": ("features", lambda: [npy_header((2**40, 2**40, 2**40))], ["features", "limit of 4096 MB"]),
    "empty with gigantic shape": ("features", lambda: [npy_header((4, 0, 2**62))], ["features", "limit of 4096 MB"]),
    "hundred dimensions": ("features", lambda: [npy_header((1,) * 100), bytes(8)], ["features", "damaged"]),
    "gigantic header": ("K", lambda: [b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**32 - 1), *zeros(1024)], ["K", "header of"]),
    "deep header": ("K", lambda: [b"\x93NUMPY\x01\x00" + struct.pack("<H", 60000) + b"(" * 60000], ["K", "damaged"]),
    "long integers": ("K", lambda: [npy_header((3,)).replace(b"(3,)", b"(9" + b"9" * 18 + b",)")], ["K"]),
}


@pytest.mark.parametrize("case", sorted(NPZ))
def test_hostile_arrays(tmp_path, case):
    key, pieces, words = NPZ[case]
    source = crafted(tmp_path, key, pieces())
    expect_refusal(convert(source), source, *words)
    assert os.listdir(str(tmp_path)) == ["crafted.npz"]


def test_an_array_within_the_limit_that_memory_does_not_hold(tmp_path):
    source = crafted(tmp_path, "features", [npy_header((4, 2**22, 8), "|i1"), *zeros(128)])  # 1 GB as doubles
    expect_refusal(convert(source), source, "not enough memory")
    assert os.listdir(str(tmp_path)) == ["crafted.npz"]


def test_members_are_never_unpacked_to_where_their_names_point(tmp_path):
    folder = tmp_path / "inner"
    folder.mkdir()
    source = crafted(folder, "unused", [b"text"], "../escaped.npy")
    with zipfile.ZipFile(source, "a") as archive:
        archive.writestr("/tmp/vi_ekf_slam_escaped.npy", b"text")
    assert convert(source).returncode == 0
    assert os.listdir(str(tmp_path)) == ["inner"] and not os.path.exists("/tmp/vi_ekf_slam_escaped.npy")


@pytest.mark.parametrize("without_end, words", [("drive", "no regular file"), ("truth", "line 1 is longer than")])
def test_files_without_end_are_not_read_to_the_end(save, tmp_path, without_end, words):
    source, *options = ["/dev/zero"] if without_end == "drive" else [save(drive()), "--truth", "/dev/zero"]
    before = os.listdir(str(tmp_path))
    done = limited([sys.executable, script_path("dataset_to_bag.py"), source, tmp_path / "out.bag", *options])
    expect_refusal(done, "/dev/zero", words)
    assert os.listdir(str(tmp_path)) == before


# run_bag, and the reader of bags in Python.

def field(name, value):
    content = name.encode() + b"=" + value
    return struct.pack("<I", len(content)) + content


def record(data, length=None, **fields):
    header = b"".join(field(name, value) for name, value in fields.items())
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data) if length is None else length) + data


def bag_of(chunk, size=None, compression=b"none", index_pos=None, encryptor=b"", index=None, connection=None):
    """A bag of one chunk whose bytes and stated size can be anything. All else is in order unless asked otherwise."""
    chunk_record = record(chunk, op=b"\x05", compression=compression, size=struct.pack("<I", len(chunk) if size is None else size))
    if index is not None:
        chunk_record += record(index, op=b"\x04", ver=struct.pack("<I", 1), conn=bytes(4),
                               count=struct.pack("<I", len(index) // 12))

    def header(position):
        return record(b" " * 64, op=b"\x03", index_pos=struct.pack("<Q", position), conn_count=struct.pack("<I", 0),
                      chunk_count=struct.pack("<I", 1), **({"encryptor": encryptor} if encryptor else {}))
    magic = b"#ROSBAG V2.0\n"
    start = len(magic) + len(header(0))
    known = b"" if connection is None else record(connection, op=b"\x07", conn=bytes(4), topic=b"/imu")
    info = known + record(b"", op=b"\x06", ver=struct.pack("<I", 1), chunk_pos=struct.pack("<Q", start), start_time=bytes(8),
                  end_time=bytes(8), count=struct.pack("<I", 0))
    position = start + len(chunk_record) if index_pos is None else index_pos
    return magic + header(position) + chunk_record + info


BLOCK = 45 * 10**6  # bytes of zeros, which make one block of bz2


def zeros_as_bz2(blocks):
    """As many BLOCKs. One is compressed and repeated, since to compress a gigabyte takes seconds: behind "BZh9" a stream
    has its blocks, which begin at any bit with 48 bits of pi and a checksum, and at its end 48 other bits and a checksum of all."""
    one = bz2.compress(bytes(BLOCK))
    bits = "{:0{}b}".format(int.from_bytes(one, "big"), 8 * len(one))
    head, block, end = bits[:32], bits[32:bits.index("{:048b}".format(0x177245385090))], "{:048b}".format(0x177245385090)
    checksum = 0
    for _ in range(blocks):
        checksum = ((checksum << 1 | checksum >> 31) & 0xFFFFFFFF) ^ int(block[48:80], 2)
    bits = head + blocks * block + end + "{:032b}".format(checksum)
    return int(bits.ljust(-len(bits) // 8 * -8, "0"), 2).to_bytes((len(bits) + 7) // 8, "big")


BOMB = zeros_as_bz2(24)  # more than 1 GB in less than a kilobyte
LONG = 2**32 - 1
IMU = field("type", b"sensor_msgs/Imu") + field("md5sum", b"6a62c6daae103f4ff57a132d6f95cec2")
READ = {"connection": IMU, "index": bytes(12)}  # one message of /imu, where the chunk begins
BAGS = {
    "empty": (b"", "is empty"),
    "text": (b"hello\n" * 100, "does not begin with"),
    "older version": (b"#ROSBAG V1.2\n" + bytes(100), "rosbag fix"),
    "header beyond the end": (b"#ROSBAG V2.0\n" + struct.pack("<I", LONG), "beyond the end"),
    "data beyond the end": (b"#ROSBAG V2.0\n" + record(b"", LONG, op=b"\x03"), "beyond the end"),
    "no index": (bag_of(b"", index_pos=0), "rosbag reindex"),
    "index elsewhere": (bag_of(b"", index_pos=20), "not where it says"),
    "index nowhere": (bag_of(b"", index_pos=2**63), "not where it says"),
    "a plugin to load": (bag_of(b"", encryptor=b"evil/Plugin"), "encrypted"),
    "unknown compression": (bag_of(b"", compression=b"zip", **READ), "allowed: none, bz2, lz4"),
    "gigantic chunk": (bag_of(b"", size=LONG, compression=b"bz2", **READ), "4294967295 bytes, allowed"),
    "bomb that says so": (bag_of(BOMB, size=24 * BLOCK, compression=b"bz2", **READ), "1080000000 bytes, allowed"),
    "bomb that says less": (bag_of(BOMB, size=1000, compression=b"bz2", **READ), "cannot be unpacked"),
    "lz4 garbage": (bag_of(bytes(1000), size=MEGABYTE, compression=b"lz4", **READ), "cannot be unpacked"),
    "record beyond its chunk": (bag_of(record(b"", LONG, op=b"\x02"), **READ), "beyond the end"),
    "index of no message": (bag_of(b"", **dict(READ, index=bytes(8) + struct.pack("<I", 2**31))), "names a message that is none"),
    "index of another's message": (bag_of(record(b"", op=b"\x02", conn=b"\1\0\0\0"), **READ), "names a message that is none"),
    "no message": (bag_of(record(b"abc", op=b"\x02", conn=bytes(4)), **READ), "cannot be read on"),
    "connection's field beyond its end": (bag_of(b"", connection=struct.pack("<I", 20000) + b"a=b"), "goes beyond the end"),
    "connection's field without name": (bag_of(b"", connection=struct.pack("<I", 3) + b"abc"), "has no name"),
    "gigantic connection": (bag_of(b"", connection=bytes(2 * MEGABYTE)), "2097152 bytes, allowed"),
}


def run_bag(path, output):
    return limited([program("run_bag"), path, "--config", CONFIG, "--output", output, "--quiet"])


@pytest.mark.parametrize("case", sorted(BAGS))
def test_hostile_bags(tmp_path, case):
    content, word = BAGS[case]
    path = tmp_path / "hostile.bag"
    path.write_bytes(content)
    expect_refusal(run_bag(path, tmp_path / "out"), path, word)
    assert os.listdir(str(tmp_path)) == ["hostile.bag"]


def io_of(command):
    """Bytes that the process of `command` asked the system for."""
    with subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL) as process:
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        with open("/proc/%d/io" % process.pid, encoding="ascii") as file:
            read = int(file.readline().split()[1])
    assert process.returncode == 0
    return read


def test_a_bag_with_large_chunks_is_read_once(bag, tmp_path):
    """Chunks of 80 MB, mostly of a topic that nobody asked for; by default rosbag's are 768 KiB."""
    import rosbag
    from std_msgs.msg import UInt8MultiArray
    path = tmp_path / "large.bag"
    with rosbag.Bag(bag) as small, rosbag.Bag(str(path), "w", chunk_threshold=80 * MEGABYTE) as large:
        for topic, message, time in small.read_messages():
            large.write(topic, message, time)
            if topic == "/features":
                large.write("/image", UInt8MultiArray(data=bytes(20 * MEGABYTE)), time)
    size = os.path.getsize(str(path))
    assert size > 160 * MEGABYTE
    asked = io_of([program("run_bag"), path, "--output", tmp_path / "out", "--quiet"])
    assert asked < 1.1 * size + 10 * MEGABYTE, (asked, size)
    assert io_of([program("run_bag"), "--check", path]) < 10 * MEGABYTE  # the index alone
    assert limited([program("run_bag"), bag, "--output", tmp_path / "small", "--quiet"]).returncode == 0
    for name in ("trajectory.tum", "landmarks.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "small" / name).read_bytes()


@pytest.mark.parametrize("case", ["bomb that says so", "bomb that says less", "gigantic chunk", "data beyond the end", "text"])
def test_hostile_bags_in_an_evaluation(run, tmp_path, case):
    path = tmp_path / "hostile.bag"
    path.write_bytes(BAGS[case][0])
    done = limited([sys.executable, script_path("plot.py"), "run", run, "--bag", path, "--output", tmp_path / "out.png"])
    expect_refusal(done, path, "cannot be read as a bag")
    assert not (tmp_path / "out.png").exists()


def test_an_honest_bag_within_the_same_limit_and_all_its_damages(bag, tmp_path):
    """Cut anywhere and with any byte changed: refused without output, or run to the end; never a crash."""
    assert run_bag(bag, tmp_path / "out").returncode == 0
    content = open(bag, "rb").read()
    random = np.random.default_rng(3)
    outcomes = []
    for k in range(24):
        damaged = bytearray(content)
        at = int(random.integers(13, len(content)))
        if k % 2:
            del damaged[at:]
        else:
            damaged[at] ^= 1 << int(random.integers(8))
        path, output = tmp_path / "damaged.bag", tmp_path / ("out_%d" % k)
        path.write_bytes(damaged)
        done = run_bag(path, output)
        assert done.returncode in (0, 2), (k, at, done.returncode, done.stderr)
        assert len(done.stderr.splitlines()) == (1 if done.returncode else 0)
        assert output.exists() or done.returncode == 2
        outcomes.append(done.returncode)
        if k % 2:
            assert done.returncode == 2 and not output.exists()
    assert 0 in outcomes and 2 in outcomes


@pytest.mark.parametrize("announced", [2**32 - 1, 2**28, 2**24])
def test_a_message_that_announces_more_than_it_holds(bag, tmp_path, announced):
    """roscpp would make room for all of them: 2**28 features are ten gigabytes."""
    content = open(bag, "rb").read()
    # An array of features follows the frame's name and begins with its length, at most the 12 of drive().
    hostile, replaced = re.subn(re.escape(LEFT_FRAME.encode()) + b"[\x01-\x0c]\x00\x00\x00",
                                lambda _: LEFT_FRAME.encode() + struct.pack("<I", announced), content)
    assert replaced >= 8
    path = tmp_path / "announces.bag"
    path.write_bytes(hostile)
    done = run_bag(path, tmp_path / "out")
    expect_refusal(done, path, "announces more elements than it holds")


# Configurations.

@pytest.mark.parametrize("text, word", [
    ("a: " * 400000, "larger than"), ("[" * 100000, "not readable as YAML"), ("estimator: [1, 2", "not readable as YAML"),
    ("map: {max_landmarks: 1e308}", "map.max_landmarks"), ("paper: {pixel_noise: .nan}", "paper.pixel_noise"),
    ("a: &a [*a]\nestimator: *a\n", "estimator"), ("estimator: !!python/object/apply:os.system [id]\n", "estimator"),
], ids=["large", "deep", "cut", "1e308", "nan", "alias of itself", "tag"])
def test_hostile_configurations(bag, tmp_path, text, word):
    config = tmp_path / "hostile.yaml"
    config.write_text(text)
    done = limited([program("run_bag"), bag, "--config", config, "--output", tmp_path / "out"])
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1, done.stderr[:2000]
    assert str(config) in done.stderr and word in done.stderr and not (tmp_path / "out").exists()
