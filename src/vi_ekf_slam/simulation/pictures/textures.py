"""Grey textures that a tracker finds corners on, drawn from a random generator; each is one of a kind."""

import cv2
import numpy as np

SIDE = 512  # px
SCALES = (4, 16, 64, 256)  # blotches along a side


def noise(random, mean, contrast=60.0):
    """SIDE x SIDE of blotches of several sizes, as floats."""
    total = np.full((SIDE, SIDE), mean, dtype=np.float32)
    for scale in SCALES:
        blotches = random.normal(size=(scale, scale)).astype(np.float32)
        total += contrast / len(SCALES) * cv2.resize(blotches, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC)
    return total


def wall(random):
    """Bricks or plaster with windows, doors and posters."""
    image = noise(random, mean=random.uniform(90.0, 170.0))
    columns, rows = random.integers(2, 5), random.integers(2, 5)
    dark = random.random() < 0.7
    for column in range(columns):
        for row in range(rows):
            x, y = ((np.array([column, row]) + random.uniform(0.15, 0.3, 2)) * SIDE / [columns, rows]).astype(int)
            w, h = (SIDE / np.array([columns, rows]) * random.uniform(0.35, 0.6, 2)).astype(int)
            shade = random.uniform(20.0, 70.0) if dark else random.uniform(190.0, 240.0)
            cv2.rectangle(image, (x - 4, y - 4), (x + w + 4, y + h + 4), float(random.uniform(160, 230)), -1)
            cv2.rectangle(image, (x, y), (x + w, y + h), float(shade), -1)
            cv2.line(image, (x + w // 2, y), (x + w // 2, y + h), 150.0, 3)
    for _ in range(12):  # posters, pipes, stains
        x, y = random.integers(0, SIDE, 2)
        w, h = random.integers(6, 50, 2)
        cv2.rectangle(image, (int(x), int(y)), (int(x + w), int(y + h)), float(random.uniform(20, 235)), -1)
    return _finish(image)


def ground(random):
    """Worn asphalt or carpet with patches and cracks."""
    image = noise(random, contrast=70.0, mean=105.0)
    for _ in range(10):
        points = random.integers(0, SIDE, (3, 1, 2)).astype(np.int32)
        cv2.polylines(image, [points], False, float(random.uniform(40, 190)), int(random.integers(2, 6)))
    for _ in range(8):
        x, y = random.integers(0, SIDE, 2)
        cv2.circle(image, (int(x), int(y)), int(random.integers(4, 26)), float(random.uniform(40, 200)), -1)
    return _finish(image)


def _finish(image):
    return np.clip(image, 0, 255).astype(np.uint8)
