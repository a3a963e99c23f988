"""Columns of numbers from a CSV file with a header line."""

import csv

import numpy as np

from vi_ekf_slam.common.errors import InputError, unreadable


def read_columns(path, names, optional=(), allow_empty=False, finite=False):
    """Columns `names`, and those of `optional` that are there, of a CSV file as {name: (N,) floats}.

    allow_empty: a header alone will do. finite: no nan, no infinity.
    """
    try:
        with open(path, encoding="ascii", newline="") as stream:
            reader = csv.DictReader(stream)
            rows, header = [(reader.line_num, row) for row in reader], reader.fieldnames or ()
    except (OSError, UnicodeDecodeError, csv.Error) as reason:
        raise unreadable(path, reason)
    if any(name not in header for name in names) or not (rows or allow_empty):
        raise InputError("%s: line 1 is '%s', with %d lines below it, allowed: at least one row with the columns %s"
                         % (path, ",".join(header)[:80], len(rows), ", ".join(names)))
    found = list(names) + [name for name in optional if name in header]
    columns = {name: np.empty(len(rows)) for name in found}
    for k, (number, row) in enumerate(rows):
        for name in found:
            try:
                columns[name][k] = float(row[name])
                if finite and not np.isfinite(columns[name][k]):
                    raise ValueError
            except (TypeError, ValueError):
                raise InputError("%s: line %d: %s is '%.40s', allowed: a %snumber"
                                 % (path, number, name, row[name] or "", "finite " if finite else ""))
    return columns
