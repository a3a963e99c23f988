#!/usr/bin/env python3
"""Count the tests in a directory of JUnit results: name the failures, end with `N passed, N failed, N skipped`.

Exits with 1 when a test failed, a result is not readable, or nothing ran. rostest repeats in rostest-*.xml what the
nodes that it starts wrote to rosunit-*.xml; the latter do not count twice.
"""

import os
import sys
import xml.etree.ElementTree as ElementTree


def result_files(directory):
    """Paths of the results, sorted."""
    for folder, _, names in sorted(os.walk(directory)):
        for name in sorted(names):
            if name.endswith(".xml") and not name.startswith("rosunit-"):
                yield os.path.join(folder, name)


def outcomes(path):
    """Yields (outcome, name of the test) of a file."""
    try:
        cases = list(ElementTree.parse(path).getroot().iter("testcase"))
    except ElementTree.ParseError:
        cases = None
    if not cases:
        yield "failed", "%s: no results" % os.path.basename(path)
        return
    for case in cases:
        name = "%s: %s.%s" % (os.path.basename(path), case.get("classname"), case.get("name"))
        if case.find("failure") is not None or case.find("error") is not None:
            yield "failed", name
        elif case.find("skipped") is not None or case.get("status") == "notrun":
            yield "skipped", name
        else:
            yield "passed", name


def main(directory):
    """Print the counts; the exit status."""
    counts = {"passed": 0, "failed": 0, "skipped": 0}
    for path in result_files(directory):
        for outcome, name in outcomes(path):
            counts[outcome] += 1
            if outcome == "failed":
                print("FAILED %s" % name)
    print("%(passed)d passed, %(failed)d failed, %(skipped)d skipped" % counts, flush=True)
    return 1 if counts["failed"] or not counts["passed"] else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
