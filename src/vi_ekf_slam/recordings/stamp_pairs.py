"""Pictures of two cameras that are of one moment, by their stamps."""

import numpy as np

PAIR_TOLERANCE = 5000000  # ns, as the node has it: front_end/pair_tolerance_s


def pair_stamps(left, right):
    """(P, 2) indices of the left and the right picture of each pair, in the order of stamps. left, right: (N,), (M,) ns."""
    if not len(left) or not len(right):
        return np.zeros((0, 2), dtype=int)
    order = np.argsort(right, kind="stable")
    place = np.clip(np.searchsorted(right[order], left), 1, max(1, len(right) - 1))
    candidates = np.stack([place - 1, np.minimum(place, len(right) - 1)])
    offsets = np.abs(right[order][candidates] - left)
    nearest = order[candidates[np.argmin(offsets, axis=0), np.arange(len(left))]]
    pairs = np.column_stack([np.arange(len(left)), nearest])[offsets.min(axis=0) <= PAIR_TOLERANCE]
    return pairs[np.argsort(left[pairs[:, 0]], kind="stable")]


def mutual_pairs(left, right):
    """Those pairs of pair_stamps of which each is the other's nearest."""
    back = {(i, j) for j, i in pair_stamps(right, left).tolist()}
    return [(i, j) for i, j in pair_stamps(left, right).tolist() if (i, j) in back]
