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
            for display in _shown(config, "rviz/Path") if "Color" in display]


def _shown(config, kind):
    """The displays of this class that are switched on."""
    return [display for display in displays_of(config) if display["Class"] == kind and display.get("Enabled", True)]


def add_legend(picture, config, size_px=13):
    """The picture (PIL, RGB) over as many rows of entries as it takes, as a new one. size_px: of the letters."""
    from PIL import Image
    rows, used = [[]], 0
    for entry in _entries(config, size_px):
        if rows[-1] and used + entry.width > picture.width:
            rows.append([])
            used = 0
        rows[-1].append((used, entry))
        used += entry.width
    height = _height(size_px)
    result = Image.new("RGB", (picture.width, picture.height + len(rows) * height), BACKGROUND)
    result.paste(picture, (0, 0))
    for k, row in enumerate(rows):
        for x, entry in row:
            result.paste(entry, (x, picture.height + k * height))
    return result


def _entries(config, size_px):
    """A picture of each."""
    for name, colour in path_entries(config):
        yield _entry([_line(colour), name], size_px)
    if _shown(config, "rviz/MarkerArray"):
        yield _entry(["Landmarks, sigma %g m" % SIGMA_GREEN, _bar, "%g m" % SIGMA_RED], size_px)
        yield _entry([_line(LOOPS), "Closed loops"], size_px)
    for grid in _shown(config, "rviz/Grid"):
        yield _entry(["Grid %g m" % grid["Cell Size"]], size_px)


def _entry(parts, size_px):
    """Texts and what draws a sample, beside each other."""
    from PIL import Image, ImageDraw
    strip = Image.new("RGB", (600, _height(size_px)), BACKGROUND)
    draw, font, x = ImageDraw.Draw(strip), _font(size_px), MARGIN
    for part in parts:
        if callable(part):
            x = part(draw, x, strip.height // 2)
        else:
            draw.text((x, MARGIN - 1), part, font=font, fill=TEXT)
            x += round(font.getlength(part) if hasattr(font, "getlength") else font.getsize(part)[0])
        x += MARGIN // 2
    return strip.crop((0, 0, x + MARGIN // 2, strip.height))


def _height(size_px):
    return size_px + 2 * MARGIN


def _line(colour):
    def draw_line(draw, x, y):
        draw.line([(x, y), (x + LINE, y)], fill=colour, width=3)
        return x + LINE
    return draw_line


def _bar(draw, x, y):
    for k in range(BAR):
        share = k / (BAR - 1)
        draw.line([(x + k, y - 5), (x + k, y + 5)], fill=(round(255 * share), round(255 * (1.0 - share)), 0))
    return x + BAR


def _font(size_px):
    """Letters that matplotlib brings along; PIL's own, of a fixed size, without it."""
    from PIL import ImageFont
    try:
        import matplotlib
        return ImageFont.truetype(os.path.join(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), size_px)
    except (ImportError, OSError):
        return ImageFont.load_default()
