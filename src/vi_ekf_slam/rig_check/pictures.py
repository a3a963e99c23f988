"""Are the pictures such that points can be found in them: exposure, texture, sharpness, both alike."""

import cv2
import numpy as np

from vi_ekf_slam.rig_check.images import read_pairs

SAMPLES = 20
# As the front end names a picture that it leaves out (front_end/picture.cpp): grey levels, share of the picture.
DARK, BRIGHT, ALL, SATURATED = 40.0, 215.0, 0.95, 250
CLIPPED = 0.3  # share at one end of the scale: as much as it calls a missing part
FEW_CORNERS = 30  # a quarter of the 130 tracks of front_end/features
# Ratio of brightness of both sides: tracking aligns patches in contrast (front_end/anchor_patch.cpp), but one side at half
# the other's loses the weak corners.
UNLIKE = 2.0
# Ratio of sharpness. A blur of 2 px (sigma) of one side makes 1.8 to 2.3, of 3 px 2.5 to 3.3 (pictures of EuRoC and KITTI, and drawn
# ones); with 3 px the rotation of a drawn rig was found 5.6 deg off.
UNSHARP, OUT_OF_FOCUS = 1.4, 2.0


def check_pictures(rig, report):
    """Of some pairs along the recording."""
    if rig.pairs is None or not len(rig.pairs):
        report.unjudged("there are no pairs of pictures")
        return
    chosen = rig.pairs[np.unique(np.linspace(0, len(rig.pairs) - 1, SAMPLES).astype(int))]
    rows, sizes, shown = [], set(), None
    for _, left, right in read_pairs(rig, chosen):
        if left is None or right is None:
            continue
        rows.append([_measure(left), _measure(right)])
        sizes |= {left.shape[::-1], right.shape[::-1]}
        shown = shown or (left, right)
    lost = "%d of %d pairs" % (len(chosen) - len(rows), len(chosen))
    if len(rows) < len(chosen) // 2:
        report.red("pictures cannot be decoded", lost, "none",
                   "encodings: mono8, mono16, bgr8, rgb8, Bayer, yuv422, yuv422_yuy2; JPEG or PNG on /compressed")
        return
    if len(rows) < len(chosen):
        report.yellow("some pictures cannot be decoded", lost, "none", "does the driver or the link lose data?")
    report.draw("a pair", _draw_pair(*shown))
    size = rig.cameras[0].size if rig.cameras else None
    if size and size[0] and any(tuple(s) != tuple(size) for s in sizes):
        report.red("pictures and camera_info are of two sizes", "%s and %d x %d px" % (
            ", ".join("%d x %d" % s for s in sorted(sizes)), *size), "equal", "calibrate at the resolution that is used")
        return
    _judge(np.array(rows), report)


def _measure(image):
    """(mean, share dark, share bright, share saturated, corners, sharpness) of one picture."""
    small = cv2.resize(image, None, fx=0.125, fy=0.125, interpolation=cv2.INTER_AREA)
    # The response of a corner of 8 levels' contrast in a window of 3: noise of 2 levels stays below it.
    response = cv2.cornerMinEigenVal(image, 3)
    strong = (response > 1e-4) & (response == cv2.dilate(response, np.ones((15, 15))))
    # What is left of fine structure beside coarse structure of the same picture: contrast cancels. Bands of 1 to 1.8 px, clear of
    # the noise of pixels, and of 3 to 6.7 px.
    picture = image.astype(np.float32)
    bands = [cv2.GaussianBlur(picture, (0, 0), sigma) for sigma in (1.0, 1.8, 3.0, 6.7)]
    sharpness = np.std(bands[0] - bands[1]) / max(1e-3, np.std(bands[2] - bands[3]))
    return (image.mean(), np.mean(small < DARK), np.mean(small > BRIGHT), np.mean(image >= SATURATED), strong.sum(), sharpness)


def _judge(values, report):
    """values: (pairs, 2, 6) of _measure."""
    median = np.median(values, axis=0)
    before = len(report.findings)
    for side, (mean, dark, bright, saturated, corners, _) in zip(("left", "right"), median):
        if dark > ALL or bright > ALL:
            report.red("%s pictures are %s" % (side, "black" if dark > ALL else "overexposed"), "%.0f of 255 in the mean" % mean,
                       "%g to %g" % (DARK, BRIGHT), "set the exposure, take off the lens cap")
        elif corners < FEW_CORNERS:
            report.yellow("%s pictures have hardly any texture" % side, "%.0f corners" % corners, "%d" % FEW_CORNERS,
                          "out of focus, blurred by a long exposure, or an empty wall?")
        elif saturated > CLIPPED:
            report.yellow("%s pictures are clipped" % side, "%.0f %% saturated" % (100.0 * saturated), "%.0f %%" % (100.0 * CLIPPED),
                          "shorten the exposure")
    if len(report.findings) > before:
        return
    for index, what, limits, advice in (
            (5, "sharp", (UNSHARP, OUT_OF_FOCUS), "focus the lens of the other; is one window dirty?"),
            (0, "bright", (UNLIKE, np.inf), "let one exposure control both cameras")):
        left, right = np.maximum(median[:, index], 1e-6)
        ratio = max(left / right, right / left)
        if ratio > limits[0]:
            report.complain(ratio > limits[1], "left and right pictures are not equally %s" % what,
                            "ratio %.2f, the %s one more" % (ratio, "left" if left > right else "right"),
                            "%g" % limits[0], advice)
    if len(report.findings) == before:
        report.green("exposure, texture, sharpness", "brightness %.0f and %.0f of 255, %.0f and %.0f corners" % (
            median[0, 0], median[1, 0], median[0, 4], median[1, 4]), "%d corners" % FEW_CORNERS)


def _draw_pair(left, right):
    def draw(axes):
        axes.imshow(np.hstack([left, right]) if left.shape == right.shape else left, cmap="gray", vmin=0, vmax=255)
        axes.set_axis_off()
    return draw
