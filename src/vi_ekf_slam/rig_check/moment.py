"""Are left and right exposed at once? Where they are not, rows differ by how fast they move times the delay, whatever the stamps say."""

import numpy as np

from vi_ekf_slam.rig_check.camera_motion import steps
from vi_ekf_slam.rig_check.stereo import MAX_ROW

LONGEST, GRID = 0.1, 5e-4  # s: delays that are tried, to what pixel noise tells on a recording that moves
FEWEST = 100  # points of a group
# px, what a track's place is off by from image to image (front_end.cpp, kPriorSigma), of which no more is to be seen than noise.
NOISE = 0.25
SIGMA = 1.48  # of a median of absolute values
# Points move so many times as far in a step as rows have noise: that of the left row is in the difference and in the speed, so that
# points at rest look delayed by half a step, and these by a third of the noise.
MOVES = 3.0


def check_moment(rig, report):
    """By the steps of the camera's motion: vR - vL against the speed of the row."""
    if rig.cameras is None or rig.frame_name is None or (rig.frame_name != "features" and rig.pairs is None):
        report.unjudged("there are neither features nor pairs of pictures")
        return
    rig.rectified = all(camera.is_rectified for camera in rig.cameras)
    tables = [np.column_stack([before[:, 1], before[:, 3] - before[:, 1], after[:, 1] - before[:, 1],
                               np.full(len(before), 1e-9 * (end - begin))]) for begin, end, before, after, _ in steps(rig)]
    table = np.concatenate(tables) if tables else np.zeros((0, 4))
    rows, differences, ways, seconds = table[np.isfinite(table).all(axis=1)].T
    speeds = ways / seconds
    delays, noise = _of_groups(differences, speeds, rows)
    if not delays or np.percentile(np.abs(ways), 75.0) < MOVES * noise:
        report.unjudged("points hardly move up and down beside their noise, or not both in the upper and in the lower half of the picture")
        return
    # As much as all groups agree on.
    delay = min(delays, key=abs) if min(delays) * max(delays) > 0.0 else 0.0
    speed = float(np.percentile(np.abs(speeds), 95.0))
    limit = max(NOISE, noise)
    figure = "%.3g ms, which is %.2g px of rows that move by %.0f px/s" % (1e3 * abs(delay), abs(delay) * speed, speed)
    if abs(delay) * speed > limit:
        report.red("right pictures are %s than left ones, although their stamps are pairs" % ("later" if delay > 0.0 else "earlier"),
                   figure, "%.2g px, the noise of rows" % limit,
                   "trigger both cameras together, by a wire or the driver's synchronisation: cameras that run free, and one that is "
                   "exposed longer or delivers a picture late, are of two moments")
    elif noise > SIGMA * MAX_ROW:
        report.unjudged("rows of matched points differ whatever the delay")
    else:
        report.green("left and right are of one moment", figure, "%.2g px, the noise of rows" % limit)


def _of_groups(differences, speeds, rows):
    """([delay s], sigma of what is left px) of points that move up and down in either half of the picture; ([], 0): too few of one.

    A row shift, another focal length or a turned camera makes rows differ too, but by where a point is or by a constant: as delays they
    have other signs in other groups. Slow points tell nothing. (N,) each: px, px/s, px.
    """
    fast = np.abs(speeds) > np.median(np.abs(speeds)) if len(speeds) else np.zeros(0, dtype=bool)
    upper = rows < np.median(rows) if len(rows) else fast
    groups = [fast & (speeds * sign > 0.0) & half for sign in (1.0, -1.0) for half in (upper, ~upper)]
    if min(group.sum() for group in groups) < FEWEST:
        return [], 0.0
    delays = [_delay(differences[group], speeds[group]) for group in groups]
    left = np.concatenate([differences[group] - delay * speeds[group] for group, delay in zip(groups, delays)])
    return delays, SIGMA * float(np.median(np.abs(left)))


def _delay(differences, speeds):
    """s, which leaves least of the differences; what is left of a wrong match counts as MAX_ROW."""
    tried = GRID * np.arange(-round(LONGEST / GRID), round(LONGEST / GRID) + 1)
    return float(tried[np.argmin([np.minimum(np.abs(differences - delay * speeds), MAX_ROW).mean() for delay in tried])])
