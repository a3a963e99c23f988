"""What a check says: one line with the figure, the limit and what to do; and the report, which knows what follows from what."""

from collections import namedtuple

GREEN, YELLOW, RED, UNJUDGED = "green", "yellow", "red", "not judged"

Finding = namedtuple("Finding", "level check text figure limit advice")
Finding.__doc__ = """level: of the four above. check: name of the check. text: what it is. figure: the value with its unit.
limit: what is allowed, with its unit. advice: what to do; empty where nothing is wrong."""


class Report:
    """Findings in the order of the checks, the most basic first, and pictures.

    A check that needs another one which is red is not made: what it found would only follow from that.
    """

    def __init__(self, name):
        self.name = name
        self.findings = []
        self.pictures = []  # (title, check, draw(axes), x, y)
        self._check = None
        self._red = {}  # check: what of it is red

    def begin(self, check, needs):
        """Whether a check can be made; else says why not. check: its name; needs: those of the checks before that it rests on."""
        self._check = check
        cause = next((self._red[need] for need in needs if need in self._red), None)
        if cause is not None:
            self._red.setdefault(check, cause)
            self.unjudged("follows from: " + cause)
        return cause is None

    def green(self, text, figure="", limit=""):
        """All is well."""
        self.findings.append(Finding(GREEN, self._check, text, figure, limit, ""))

    def yellow(self, text, figure, limit, advice):
        """It works, but worse than it could."""
        self.findings.append(Finding(YELLOW, self._check, text, figure, limit, advice))

    def red(self, text, figure, limit, advice):
        """Nothing good comes of it."""
        self.findings.append(Finding(RED, self._check, text, figure, limit, advice))
        self._red.setdefault(self._check, text)

    def complain(self, is_red, text, figure, limit, advice):
        """Red where `is_red`, else yellow."""
        (self.red if is_red else self.yellow)(text, figure, limit, advice)

    def unjudged(self, reason):
        """The data do not tell."""
        self.findings.append(Finding(UNJUDGED, self._check, "not judged", "", "", reason))

    def draw(self, title, draw, x="", y=""):
        """A picture to this check; draw(axes) is called where pictures are wanted. x, y: what the axes show, with its unit."""
        self.pictures.append((title, self._check, draw, x, y))

    def of_level(self, level):
        """The findings of one level, in order."""
        return [finding for finding in self.findings if finding.level == level]

    @property
    def first(self):
        """The finding to begin with: the first red one, else the first yellow one, else None."""
        return next(iter(self.of_level(RED) + self.of_level(YELLOW)), None)
