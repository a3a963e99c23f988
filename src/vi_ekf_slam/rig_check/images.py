"""Pictures of a bag: pairs by stamp, decoded to 8 bit grey as the front end takes them."""

import cv2
import numpy as np

from vi_ekf_slam.bag.opening import open_bag

# sensor_msgs/Image: (bits, channels, what OpenCV makes grey of it).
ENCODINGS = {"mono8": (8, 1, None), "8UC1": (8, 1, None), "mono16": (16, 1, None), "16UC1": (16, 1, None),
             "yuv422": (8, 2, cv2.COLOR_YUV2GRAY_UYVY), "yuv422_yuy2": (8, 2, cv2.COLOR_YUV2GRAY_YUY2)}
for _bits in (8, 16):
    ENCODINGS.update({"%s%d" % (name, _bits): (_bits, channels, conversion) for name, channels, conversion in (
        ("bgr", 3, cv2.COLOR_BGR2GRAY), ("rgb", 3, cv2.COLOR_RGB2GRAY), ("bgra", 4, cv2.COLOR_BGRA2GRAY), ("rgba", 4, cv2.COLOR_RGBA2GRAY),
        ("bayer_rggb", 1, cv2.COLOR_BayerBG2GRAY), ("bayer_bggr", 1, cv2.COLOR_BayerRG2GRAY),
        ("bayer_gbrg", 1, cv2.COLOR_BayerGR2GRAY), ("bayer_grbg", 1, cv2.COLOR_BayerGB2GRAY))})


def read_pairs(rig, pairs):
    """Yield (k, left, right), 8 bit grey, of the rows k of `pairs` (pair_stamps) in order. A picture that cannot be decoded is None."""
    left, right = rig.streams["left_image"], rig.streams["right_image"]
    number = {("left", int(left.stamps[i])): k for k, (i, _) in enumerate(pairs)}
    number.update({("right", int(right.stamps[j])): k for k, (_, j) in enumerate(pairs)})
    if not len(pairs):
        return
    received = np.concatenate([left.received[pairs[:, 0]], right.received[pairs[:, 1]]])
    import genpy
    begin, end = (genpy.Time(*divmod(int(t), 10**9)) for t in (received.min(), received.max()))
    sides, held = {left.topic: "left", right.topic: "right"}, {}
    bits = 8  # in use so far: a brighter picture has one more, and is as bright as those before
    with open_bag(rig.path) as bag:
        for topic, message, _ in bag.read_messages([left.topic, right.topic], begin, end):
            k = number.pop((sides[topic], message.header.stamp.to_nsec()), None)
            if k is None:
                continue
            image = _decode(message)
            if image is not None and image.dtype != np.uint8:
                bits = max(bits, int(image.max()).bit_length())
            held.setdefault(k, {})[sides[topic]] = image
            if len(held[k]) == 2:
                pair = held.pop(k)
                yield k, _eight_bits(pair["left"], bits), _eight_bits(pair["right"], bits)


def _decode(message):
    """(rows, columns) uint8 or uint16 of a sensor_msgs/Image or CompressedImage; None where that cannot be."""
    if hasattr(message, "format"):
        try:
            return cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
        except cv2.error:  # of no bytes, or of a size beyond all pictures
            return None
    if message.encoding not in ENCODINGS:
        return None
    bits, channels, conversion = ENCODINGS[message.encoding]
    dtype = np.dtype(np.uint8 if bits == 8 else ">u2" if message.is_bigendian else "<u2")
    width = message.width * channels
    if message.step < width * dtype.itemsize or len(message.data) < message.step * message.height:
        return None
    rows = np.frombuffer(message.data, np.uint8)[:message.step * message.height].reshape(message.height, message.step)
    image = np.ascontiguousarray(rows[:, :width * dtype.itemsize]).view(dtype).astype(np.uint8 if bits == 8 else np.uint16)
    image = image.reshape(message.height, message.width, channels) if channels > 1 else image
    return image if conversion is None else cv2.cvtColor(image, conversion)


def _eight_bits(image, bits):
    """The highest 8 of `bits`."""
    if image is None or image.dtype == np.uint8:
        return image
    return (image >> (bits - 8)).astype(np.uint8)
