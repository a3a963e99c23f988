"""Do points lie in one row of both pictures, and on the side that makes them be in front? From matches, or from features."""

import cv2
import numpy as np

from vi_ekf_slam.rig_check.images import read_pairs

SAMPLES = 12  # pairs that are looked at
FEWEST = 40  # points that tell
FEWEST_MATCHES = 30  # a pair; of two pictures of nothing in common, chance made 18 that one fundamental matrix explains
# px: beyond it the front end takes no match (front_end/stereo_matcher.cpp), so that a median there loses half of them.
MAX_ROW = 1.5
GOOD_ROW = 0.75
PIXEL_SIGMA = 1.0  # px, invariant/pixel_sigma: of a coordinate, where messages state none
# Of rows of noise sigma each the median difference, over sigma; and 3.6 standard deviations of that of FEWEST_ROWS points.
MEDIAN_OF_ROWS, NOISE_FACTOR, FEWEST_ROWS = 0.954, 1.3, 200
SWAPPED = 0.6  # share of points behind the cameras; noise of points at infinity alone makes up to a half
OUTSIDE = 0.05  # share; the node drops what is outside, and a rectified picture may lose its margin
FARTHEST = 1.0  # px: less disparity has no sign
ROW_AXES = "row in the left picture, px", "px (cut at 10)"


def check_stereo(rig, report):
    """Rows and sign of the disparity."""
    if rig.cameras is None:
        report.unjudged("camera_info of both sides is needed")
        return
    if "features" in rig.streams:
        _judge_features(rig, report)
    elif rig.pairs is not None and len(rig.pairs):
        _judge_pictures(rig, report)
    else:
        report.unjudged("there are neither features nor pairs of pictures")


def _judge_features(rig, report):
    pixels = [p for _, p in rig.frames if len(p)]
    if not pixels or sum(map(len, pixels)) < FEWEST:
        report.red("features are empty", "%d points" % sum(map(len, pixels)), "%d" % FEWEST, "see what the front end says")
        return
    pixels = np.concatenate(pixels)
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    width, height = rig.cameras[0].size
    known = width and height and rig.cameras[0].is_rectified  # else the camera shows more than the rectified picture
    outside = ((pixels[:, :2] < -0.5) | (pixels[:, :2] > [width, height])).any(axis=1).mean() if known else 0.0
    if outside > OUTSIDE:
        report.red("features lie outside of the picture that camera_info describes", "%.0f %% outside of %d x %d px" % (
            100.0 * outside, width, height), "%.0f %%" % (100.0 * OUTSIDE), "is camera_info that of another resolution?")
        return
    rows, disparity = pixels[:, 1] - pixels[:, 3], pixels[:, 0] - pixels[:, 2]
    report.draw("rows of matched points: left minus right, px", _draw_rows(pixels[:, 1], rows), *ROW_AXES)
    behind = _share_behind(disparity)
    if behind > SWAPPED:
        report.red("disparity has the wrong sign", "%.0f %% of the points are behind the cameras" % (100.0 * behind), "%.0f %%" % (
            100.0 * SWAPPED), "exchange left and right: u_left must be the larger one")
        return
    # A fifth more than noise makes is no longer that.
    expected = 1.2 * MEDIAN_OF_ROWS * max(PIXEL_SIGMA, rig.stated_sigma)
    _say_rows(report, float(np.median(np.abs(rows))), len(rows), "the features are not those of rectified pictures: rectify their pixels "
              "with D, K, R and P of camera_info", expected, max(MAX_ROW, 2.0 * expected))
    _say_noise(rig, rows, report)


def _say_noise(rig, rows, report):
    """Whether rows differ by more than the noise that the messages state, as the node judges it (sensors/stereo_check.cpp)."""
    stated, noise = rig.stated_sigma, float(np.median(np.abs(rows))) / MEDIAN_OF_ROWS
    if 0.0 < stated < noise / NOISE_FACTOR and len(rows) >= FEWEST_ROWS:
        report.yellow("pixel noise is larger than stated", "%.2g px by the rows of %d points, stated %.2g px" % (noise, len(rows), stated),
                      "%.2g px" % (NOISE_FACTOR * stated), "state the noise that there is in sigma of the features, or rectify more exactly")


def _share_behind(disparity):
    clear = disparity[np.abs(disparity) > FARTHEST]
    return float(np.mean(clear < 0.0)) if len(clear) >= FEWEST // 2 else 0.0


def _say_rows(report, error, count, advice, good=GOOD_ROW, limit=MAX_ROW):
    figure = "%.2f px (median of %d points)" % (error, count)
    if error > limit:
        report.red("matched points lie in different rows", figure, "%.3g px" % limit, advice)
    elif error > good:
        report.yellow("matched points lie in somewhat different rows", figure, "%.3g px" % good, "calibrate the pair again")
    else:
        report.green("matched points lie in one row, in front of the cameras", figure, "%.3g px" % good)


def match(left, right):
    """(N, 4) px uL vL uR vR of ORB matches that one fundamental matrix explains to 2 px."""
    orb = cv2.ORB_create(1000)
    (points_l, descriptors_l), (points_r, descriptors_r) = (orb.detectAndCompute(image, None) for image in (left, right))
    if descriptors_l is None or descriptors_r is None:
        return np.zeros((0, 4))
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(descriptors_l, descriptors_r)
    found = np.array([points_l[m.queryIdx].pt + points_r[m.trainIdx].pt for m in matches if m.distance < 50])
    if len(found) < 15:
        return np.zeros((0, 4))
    _, mask = cv2.findFundamentalMat(found[:, :2], found[:, 2:], cv2.FM_RANSAC, 2.0, 0.99)
    return found[mask.ravel() > 0] if mask is not None else np.zeros((0, 4))


class _Reading:
    """How the matches look when pictures are taken as raw or rectified, and exchanged or not."""

    def __init__(self, found, cameras, rectified, exchanged):
        self.rectified, self.exchanged = rectified, exchanged
        parts = (found[:, :2], found[:, 2:])
        left, right = parts[::-1] if exchanged else parts
        widths = np.ones(len(left))
        if not rectified:
            widths = cameras[0].magnifications(left)
            left, right = cameras[0].rectify(left), cameras[1].rectify(right)
        # In px of the picture as it is, in which the front end judges them too.
        self.v, self.rows, self.disparity = left[:, 1], (left[:, 1] - right[:, 1]) / widths, (left[:, 0] - right[:, 0]) / widths
        self.error = float(np.median(np.abs(self.rows)))
        self.behind = _share_behind(self.disparity)

    @property
    def is_good(self):
        """Rows agree, and the points are in front."""
        return self.error <= MAX_ROW and self.behind <= SWAPPED


def _judge_pictures(rig, report):
    chosen = rig.pairs[np.unique(np.linspace(0, len(rig.pairs) - 1, SAMPLES).astype(int))]
    found, shown = [], None
    for _, left, right in read_pairs(rig, chosen):
        if left is None or right is None:
            continue
        matches = match(left, right)
        if len(matches):
            found.append(matches)
            if shown is None or len(matches) > len(shown[2]):
                shown = left, right, matches
    count = sum(map(len, found))
    if shown:
        report.draw("matches of left and right: lines are level where rows agree", _draw_matches(*shown))
    if count < FEWEST_MATCHES * len(chosen):
        report.red("left and right pictures do not show the same", "%.0f matches a pair" % (count / len(chosen)), "%d" % FEWEST_MATCHES,
                   "are they of one rig and of one time, sharp and of one exposure?")
        return
    found = np.concatenate(found)
    stated = all(camera.is_rectified for camera in rig.cameras)
    readings = [_Reading(found, rig.cameras, rectified, exchanged)
                for exchanged in (False, True) for rectified in ((stated,) if stated else (False, True))]
    as_is = readings[0]
    report.draw("rows of matched points: left minus right, px", _draw_rows(as_is.v, as_is.rows), *ROW_AXES)
    if as_is.is_good:
        rig.rectified = stated
        _say_rows(report, as_is.error, len(found), "")
        return
    other = next((reading for reading in readings[1:] if reading.is_good), None)
    if as_is.behind > SWAPPED and (other is None or other.exchanged):
        report.red("left and right pictures are exchanged", "%.0f %% of the matched points are behind the cameras" % (
            100.0 * as_is.behind), "%.0f %%" % (100.0 * SWAPPED), "exchange the topics: left_image:=..., right_image:=...")
    elif other is not None and other.rectified:
        report.red("the pictures are rectified already, camera_info is of the raw ones",
                   "rows differ by %.2f px as raw, by %.2f px as rectified" % (as_is.error, other.error), "%g px" % MAX_ROW,
                   "set front_end/images: rectified")
    elif other is not None:
        report.red("left and right pictures are exchanged", "rows differ by %.2f px, exchanged by %.2f px" % (
            as_is.error, other.error), "%g px" % MAX_ROW, "exchange the topics: left_image:=..., right_image:=...")
    else:
        _say_rows(report, as_is.error, len(found), _advice(stated, as_is.rows))


def _advice(stated, rows):
    middle, spread = float(np.median(rows)), float(1.48 * np.median(np.abs(rows - np.median(rows))))
    if abs(middle) > 3.0 * spread and spread < MAX_ROW:
        return "the right picture is shifted by %.1f rows: cy of one camera, a crop, or a lens that has moved; calibrate again" % middle
    if stated:
        return "the pictures are not rectified although camera_info says so (D is 0): give the raw calibration in D, K, R and P"
    return "camera_info does not fit these pictures: calibration of another rig, lens or resolution? calibrate again"


def _draw_rows(v, rows):
    def draw(axes):
        step = max(1, len(v) // 3000)
        axes.plot(v[::step], np.clip(rows, -10.0, 10.0)[::step], ".", markersize=2)
        for limit in (-MAX_ROW, MAX_ROW):
            axes.axhline(limit, color="C3", linewidth=0.8)
    return draw


def _draw_matches(left, right, matches):
    def draw(axes):
        width = left.shape[1]
        axes.imshow(np.hstack([left, right]) if left.shape == right.shape else left, cmap="gray")
        for u_l, v_l, u_r, v_r in matches[::max(1, len(matches) // 60)]:
            axes.plot([u_l, u_r + width], [v_l, v_r], color="C1", linewidth=0.6)
        axes.set_axis_off()
    return draw
