"""The paper's figures as one HTML page: no other file, no network, for a phone and a desk, in light and dark."""

import base64
import shlex
import struct
from html import escape

from vi_ekf_slam.evaluation.report import DEFINITIONS, ROWS, cell
from vi_ekf_slam.paper.figures import DRIVES, KINDS, METHODS, SIDES, figures_of

GLANCE = [row for row in ROWS if row[3][-1] in ("ate_m", "t_rel_percent", "r_rel_deg_per_100m", "pose_nees")]

STYLE = """
:root { color-scheme: light dark;
        --ink: #1b1f24; --ground: #ffffff; --soft: #f2f4f7; --line: #c9d1d9; --link: #0b57d0; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e3e7ec; --ground: #14171b; --soft: #20252b; --line: #424a53; --link: #8ab4f8; }
  img { filter: brightness(0.88); }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 78rem; padding: 1rem; color: var(--ink); background: var(--ground);
       font: 1rem/1.5 system-ui, sans-serif; overflow-wrap: break-word; -webkit-text-size-adjust: 100%; }
h1 { font-size: 1.6rem; line-height: 1.25; }
h2 { margin: 2.5rem 0 0.5rem; padding-top: 0.5rem; border-top: 1px solid var(--line); font-size: 1.35rem; }
h3 { margin: 1.5rem 0 0.5rem; font-size: 1.1rem; }
a { color: var(--link); }
p, dl { max-width: 48rem; }
dt { font-weight: 600; }
dd { margin: 0 0 0.5rem 1rem; }
.pair { display: grid; gap: 1.5rem; grid-template-columns: repeat(auto-fit, minmax(min(100%, 26rem), 1fr)); }
figure { margin: 0; min-width: 0; }
img { display: block; width: 100%; height: auto; background: #ffffff; border: 1px solid var(--line);
      border-radius: 6px; }
figcaption { margin-top: 0.5rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 0.3rem 0.7rem; border-bottom: 1px solid var(--line); text-align: right; white-space: nowrap; }
th { font-weight: 600; }
thead th { vertical-align: bottom; white-space: normal; min-width: 5.5rem; }
th:first-child { position: sticky; left: 0; min-width: 8.5rem; text-align: left; white-space: normal;
                 background: var(--ground); }
pre { margin: 0.5rem 0; padding: 0.7rem; overflow-x: auto; background: var(--soft); border-radius: 6px;
      font-size: 0.85rem; }
summary { cursor: pointer; padding: 0.3rem 0; color: var(--link); }
"""
# Nothing may be loaded from elsewhere, not even by a mistake of ours.
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def make_page(drives, numbers, configurations, pictures, setting):
    """The page's text, well-formed as XML too.

    drives: names, of those present. numbers: {drive: {method: of evaluation.report.to_data, with "commands"}}.
    configurations: {name: text}. pictures: {(figure's number, side): PNG file}. setting: the shell's (variable, value).
    """
    parts = [_introduction(drives), _glance(drives, numbers)]
    for kind in KINDS:
        parts.append("<h2>%s</h2>\n<p>%s</p>" % (escape(_capital(kind.name)), escape(kind.explanation)))
        parts += [_figure(f, numbers[f.drive], pictures) for f in figures_of(drives) if f.kind is kind]
    parts += [_everything(drives, numbers), _definitions(), _what_was_run(configurations, setting)]
    return PAGE % {"title": "Figures 1 to 9", "policy": POLICY, "style": STYLE, "body": "\n".join(parts)}


PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8" />
<meta name="viewport" content="width=device-width, initial-scale=1" />
<meta http-equiv="Content-Security-Policy" content="%(policy)s" />
<title>%(title)s</title>
<link rel="icon" href="data:," />
<style>%(style)s</style>
</head>
<body>
<main>
%(body)s
</main>
</body>
</html>
"""


def _capital(text):
    return text[0].upper() + text[1:]


def _introduction(drives):
    missing = [drive for drive in DRIVES if drive not in drives]
    links = " ".join('<a href="#figure-%d">Fig. %d</a>' % (f.number, f.number) for f in figures_of(drives))
    text = ("<h1>Visual-inertial SLAM: figures 1 to 9</h1>\n<p>Dead reckoning, visual map and SLAM for the drives %s, "
            "with the paper's filter and its values, and with ours beside it. Both pictures of a figure have the same "
            "view and the same colours; all are seen from above, in metres, and begin at the origin.</p>\n"
            % escape(_and(DRIVES)))
    if missing:
        text += "<p><strong>Missing: %s.</strong> Their figures are left out.</p>\n" % escape(_and(missing))
    return text + "<nav aria-label=\"Figures\"><p>%s</p></nav>" % links


def _and(words):
    words = list(words)
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def _scroll(label, table):
    """A table that scrolls by itself, with the keyboard too, where the screen is narrow."""
    return '<div class="scroll" role="region" tabindex="0" aria-label="%s">\n%s\n</div>' % (escape(label), table)


def _table(header, rows):
    """Cells are text. The first column and the header are headings."""
    head = "".join('<th scope="col">%s</th>' % escape(text) for text in header)
    body = "\n".join('<tr><th scope="row">%s</th>%s</tr>' % (
        escape(row[0]), "".join("<td>%s</td>" % escape(text) for text in row[1:])) for row in rows)
    return "<table>\n<thead><tr>%s</tr></thead>\n<tbody>\n%s\n</tbody>\n</table>" % (head, body)


def _row_title(row):
    return "%s (%s)" % row[:2] if row[1] else row[0]


def _glance(drives, numbers):
    text = ('<h2>Errors</h2>\n<p>Against the truth, where it is known. What each number means is '
            '<a href="#definitions">below</a>; a NEES far above 6 means that the covariance is too small.</p>')
    for drive in drives:
        text += "\n<h3>%s</h3>\n" % escape(drive)
        if not _has_truth(numbers[drive]):
            text += "<p>There is no truth for this drive, so no errors can be stated.</p>"
            continue
        rows = [[METHODS[name].label] + [cell(data, row) for row in GLANCE] for name, data in numbers[drive].items()]
        text += _scroll("Errors for %s" % drive, _table(["filter"] + [_row_title(row) for row in GLANCE], rows))
    return text


def _has_truth(numbers_of_drive):
    return any(data["slam"] is not None for data in numbers_of_drive.values())


def _figure(figure, numbers, pictures):
    caption = "Fig. %d. %s" % (figure.number, figure.kind.caption % figure.drive)
    sides = "\n".join(_side(figure, side, method, numbers[method], pictures[figure.number, side])
                      for side, method in zip(SIDES, figure.kind.methods))
    return '<section id="figure-%d">\n<h3>%s</h3>\n<div class="pair">\n%s\n</div>\n</section>' % (
        figure.number, escape(caption), sides)


def _side(figure, side, method, data, png):
    width, height = struct.unpack(">II", png[16:24])  # of the header, so that the page does not jump while it loads
    errors = "No truth for this drive, so no errors."
    if data["slam"] is not None:
        errors = "; ".join(("%s: %s %s" % (row[0], cell(data, row), row[1])).strip() for row in GLANCE) + "."
    return ('<figure>\n<img src="data:image/png;base64,%s" width="%d" height="%d" alt="%s" />\n'
            '<figcaption>\n<p><strong>%s</strong> (%s). %s</p>\n'
            '<details><summary>What was run</summary>\n<p>Configuration: <a href="#config-%s">%s.yaml</a></p>\n'
            '<pre>%s</pre>\n</details>\n</figcaption>\n</figure>') % (
                base64.b64encode(png).decode("ascii"), width, height, escape(_alternative(figure, side, data)),
                escape(_capital(SIDES[side])), escape(METHODS[method].label), escape(errors),
                METHODS[method].config, METHODS[method].config, escape("\n".join(data["commands"])))


def _alternative(figure, side, data):
    """What the picture shows, for those who do not see it."""
    what = {"dead reckoning": "the trajectory without the camera",
            "visual map": "the landmarks, coloured by their standard deviation, and the trajectory",
            "SLAM": "the trajectory and the landmarks, beside dead reckoning"}[figure.kind.name]
    text = "Drive %s from above, axes x and y in metres: %s, by %s" % (figure.drive, what, SIDES[side])
    if data["slam"] is None:
        return text + "; there is no truth to compare with."
    return text + "; beside the truth, %.0f m long, from which it is %.2f m away (RMSE after alignment)." % (
        data["slam"]["true_path_m"], data["slam"]["ate_m"])


def _everything(drives, numbers):
    text = "<h2>All numbers</h2>\n<p>As evaluate.py computes them.</p>"
    for drive in drives:
        runs = numbers[drive].values()
        rows = [[_row_title(row) if row[0] else "in %s" % row[1]] + [cell(data, row) for data in runs] for row in ROWS]
        rows = [row for row in rows if any(text != "-" for text in row[1:])]
        table = _table([drive] + [METHODS[name].label for name in numbers[drive]], rows)
        text += "\n<h3>%s</h3>\n%s" % (escape(drive), _scroll("All numbers for %s" % drive, table))
    return text


def _definitions():
    items = "\n".join("<dt>%s</dt><dd>%s</dd>" % (escape(name), escape(text)) for name, text in DEFINITIONS.items())
    return '<h2 id="definitions">What the numbers mean</h2>\n<dl>\n%s\n</dl>' % items


def _what_was_run(configurations, setting):
    variables = "\n".join("%s=%s" % (name, shlex.quote(value)) for name, value in setting)
    text = ("<h2>What was run</h2>\n<p>The commands below each figure, in a shell with the package's setup.bash "
            "sourced and these variables set:</p>\n<pre>%s</pre>\n<p>The configurations:</p>" % escape(variables))
    for name, content in configurations.items():
        text += '\n<details id="config-%s"><summary>%s.yaml</summary>\n<pre>%s</pre>\n</details>' % (
            name, name, escape(content))
    return text
