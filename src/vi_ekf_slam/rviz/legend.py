"""The legend under rviz's pictures: what the lines are, and which colour a landmark of which standard deviation has."""

import os

from vi_ekf_slam.rviz.config import displays_of

MARGIN, LINE, BAR = 8, 26, 90  # px: between entries, length of a line's sample, length of the colours' bar
# As src/ros/output/map_messages.cpp colours landmarks: m at the ends; the scale is logarithmic.
SIGMA_GREEN, SIGMA_RED = 0.1, 10.0
LOOPS = (255, 0, 255)  # as the same file colours the lines between their ends
BACKGROUND, TEXT = (20, 20, 25), (235, 235, 235)


def path_entries(config):
    """[(name, (red, green, blue))] of the paths that a configuration shows."""
    return [(str(display["Name"]), tuple(int(part) for part in str(display["Color"]).split(";")))
            for display in displays_of(config)
            if display["Class"] == "rviz/Path" and display.get("Enabled", True) and "Color" in display]


def has_landmarks(config):
    """Whether it shows landmarks as markers."""
    return any(display["Class"] == "rviz/MarkerArray" and display.get("Enabled", True) for display in displays_of(config))


def add_legend(picture, config, size_px=13):
    """The picture (PIL, RGB) over a strip of entries, as a new one. size_px: of the letters."""
    from PIL import Image, ImageDraw
    height = size_px + 2 * MARGIN
    result = Image.new("RGB", (picture.width, picture.height + height), BACKGROUND)
    result.paste(picture, (0, 0))
    draw, font, x = ImageDraw.Draw(result), _font(size_px), MARGIN
    middle, top = picture.height + height // 2, picture.height + MARGIN - 1

    def write(text, x):
        draw.text((x, top), text, font=font, fill=TEXT)
        return x + round(font.getlength(text) if hasattr(font, "getlength") else font.getsize(text)[0])

    for name, colour in path_entries(config):
        draw.line([(x, middle), (x + LINE, middle)], fill=colour, width=3)
        x = write(name, x + LINE + MARGIN // 2) + 2 * MARGIN
    if has_landmarks(config):
        x = write("Landmarks, sigma %g m" % SIGMA_GREEN, x) + MARGIN // 2
        for k in range(BAR):
            share = k / (BAR - 1)
            draw.line([(x + k, middle - 5), (x + k, middle + 5)],
                      fill=(round(255 * share), round(255 * (1.0 - share)), 0))
        x = write("%g m" % SIGMA_RED, x + BAR + MARGIN // 2) + 2 * MARGIN
        draw.line([(x, middle), (x + LINE, middle)], fill=LOOPS, width=3)
        write("Closed loops", x + LINE + MARGIN // 2)
    return result


def _font(size_px):
    """Letters that matplotlib brings along; PIL's own, of a fixed size, without it."""
    from PIL import ImageFont
    try:
        import matplotlib
        return ImageFont.truetype(os.path.join(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), size_px)
    except (ImportError, OSError):
        return ImageFont.load_default()
