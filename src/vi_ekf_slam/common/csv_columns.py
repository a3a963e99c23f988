"""Columns of numbers from a CSV file with a header line."""

import csv

import numpy as np

from vi_ekf_slam.common.errors import InputError


def read_columns(path, names, optional=(), allow_empty=False):
    """Columns `names`, and those of `optional` that are there, of a CSV file as {name: (N,) floats}.

    allow_empty: a header alone will do.
    """
    try:
        with open(path, encoding="ascii", newline="") as stream:
            reader = csv.DictReader(stream)
            rows, header = list(reader), reader.fieldnames or ()
    except (OSError, UnicodeDecodeError, csv.Error) as reason:
        raise InputError("%s: cannot be read: %s" % (path, reason))
    if any(name not in header for name in names) or not (rows or allow_empty):
        raise InputError("%s: allowed: at least one row with the columns %s" % (path, ", ".join(names)))
    found = list(names) + [name for name in optional if name in header]
    try:
        return {name: np.array([float(row[name]) for row in rows]) for name in found}
    except (TypeError, ValueError):
        raise InputError("%s: holds something that is no number" % path)
