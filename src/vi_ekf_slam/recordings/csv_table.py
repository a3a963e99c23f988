"""Tables of numbers whose first column is a stamp in integer nanoseconds, as ASL folders have them."""

import numpy as np

from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.yaml_file import read_text
from vi_ekf_slam.recordings.recording import increasing_rows


def read_rows(path):
    """Lists of words of all lines but empty ones and those that begin with #, with their numbers: [(number, words)]."""
    rows = [(number, [word.strip() for word in line.split(",")])
            for number, line in enumerate(read_text(path).split("\n"), start=1)
            if line.strip() and not line.lstrip().startswith("#")]
    if not rows:
        raise InputError("%s: holds no line of data" % path)
    return rows


def read_stamp(path, number, word):
    """Integer ns."""
    try:
        stamp = int(word)
        if not 0 <= stamp < 2**63:
            raise ValueError
        return stamp
    except ValueError:
        raise InputError("%s: line %d begins with '%s', allowed: a stamp in ns" % (path, number, word))


def read_table(path, columns, faults):
    """(stamps (N,) ns, values (N, columns)); surplus columns are not read. Stamps that do not increase are added to `faults`."""
    stamps, values = [], []
    for number, words in read_rows(path):
        stamps.append(read_stamp(path, number, words[0]))
        try:
            values.append([float(word) for word in words[1:1 + columns]])
        except ValueError:
            values.append([])
        if len(values[-1]) != columns or not np.all(np.isfinite(values[-1])):
            raise InputError("%s: line %d is '%s', allowed: a stamp and %d finite numbers"
                             % (path, number, ",".join(words)[:80], columns))
    stamps = np.array(stamps, dtype=np.int64)
    kept = increasing_rows(stamps, path, faults)
    return stamps[kept], np.array(values)[kept]
