"""The report on a terminal and as one HTML file that needs no other."""

import base64
import io
import textwrap
from html import escape

from vi_ekf_slam.paper.page import POLICY, STYLE
from vi_ekf_slam.rig_check.finding import GREEN, RED, UNJUDGED, YELLOW

MARKS = {GREEN: "ok", YELLOW: "WARN", RED: "FAULT", UNJUDGED: "--"}
COLOURS = {GREEN: "\033[32m", YELLOW: "\033[33m", RED: "\033[1;31m", UNJUDGED: "\033[2m"}
WIDTH = 118
OWN_STYLE = """
.green .level { background: #1a7f37; } .yellow .level { background: #9a6700; } .red .level { background: #cf222e; }
.unjudged .level { background: #6e7781; } .level { color: #ffffff; border-radius: 4px; padding: 0.1rem 0.45rem; white-space: nowrap; }
td { text-align: left; white-space: normal; vertical-align: top; }
.first { padding: 0.8rem 1rem; border-left: 6px solid #1a7f37; background: var(--soft); } .first.red { border-color: #cf222e; }
.first.yellow { border-color: #9a6700; }
"""


def verdict(report):
    """One sentence: what to begin with."""
    first = report.first
    if first is None:
        unknown = ", ".join(finding.check for finding in report.of_level(UNJUDGED))
        return "Nothing is wrong with this rig%s." % (", as far as could be judged; not judged: " + unknown if unknown else "")
    return "%s: %s (%s; allowed: %s). %s%s" % ("First" if first.level == RED else "Usable; to be better", first.text, first.figure,
                                               first.limit, first.advice[:1].upper() + first.advice[1:], "" if first.advice.endswith("?") else ".")


def text(report, colour=False):
    """Lines for a terminal."""
    lines = ["%s" % report.name, ""]
    for finding in report.findings:
        mark = "%-5s" % MARKS[finding.level]
        if colour:
            mark = COLOURS[finding.level] + mark + "\033[0m"
        body = finding.text if finding.level != UNJUDGED else "not judged: " + finding.advice
        if finding.figure:
            body += ": " + finding.figure
        if finding.limit:
            body += " (allowed: %s)" % finding.limit
        wrapped = textwrap.wrap(body, WIDTH - 27) or [""]
        lines.append("%s  %-18s %s" % (mark, finding.check, wrapped[0]))
        lines += [" " * 26 + line for line in wrapped[1:]]
        if finding.level in (YELLOW, RED):
            lines += [" " * 26 + line for line in textwrap.wrap("-> " + finding.advice, WIDTH - 27)]
    counts = ", ".join("%d %s" % (len(report.of_level(level)), level) for level in (RED, YELLOW, GREEN, UNJUDGED))
    return "\n".join(lines + ["", counts, ""] + textwrap.wrap(verdict(report), WIDTH))


def page(report):
    """The HTML file's text, with all pictures in it."""
    first = report.first
    rows = []
    for finding in report.findings:
        rows.append('<tr class="%s"><td><span class="level">%s</span></td><td>%s</td><td>%s</td><td>%s</td><td>%s</td><td>%s</td></tr>' % (
            ("unjudged" if finding.level == UNJUDGED else finding.level,) + tuple(escape(part) for part in (
                finding.level, finding.check, finding.text, finding.figure, finding.limit, finding.advice))))
    figures = ["<figure><img alt=\"%s\" src=\"data:image/png;base64,%s\"/><figcaption>%s: %s</figcaption></figure>" % (
        escape(title), base64.b64encode(_png(draw, x, y)).decode("ascii"), escape(check), escape(title))
        for title, check, draw, x, y in report.pictures]
    head = ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"/><meta http-equiv="Content-Security-Policy" content="%s"/>'
            '<meta name="viewport" content="width=device-width, initial-scale=1"/><title>%s</title><style>%s%s</style></head><body>')
    return "\n".join(
        [head % (escape(POLICY), escape("Rig: " + report.name), STYLE, OWN_STYLE), "<h1>%s</h1>" % escape("Rig: " + report.name),
         '<p class="first %s">%s</p>' % (first.level if first else "green", escape(verdict(report))),
         '<div class="scroll"><table><thead><tr><th>level</th><th>check</th><th>what</th><th>figure</th><th>allowed</th><th>what to do'
         "</th></tr></thead><tbody>"] + rows + ["</tbody></table></div>", "<h2>Pictures</h2>", '<div class="pair">'] + figures +
        ["</div>", "</body></html>", ""])


def _png(draw, x, y):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    figure = Figure(figsize=(7.0, 3.6), dpi=90)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(111)
    draw(axes)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper right", markerscale=2)
    figure.tight_layout()
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()
