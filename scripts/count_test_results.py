#!/usr/bin/env python3
"""Count the tests in a directory of JUnit results: name the failures, end with `N passed, N failed, N skipped`.

Exits with 1 when a test failed, a result is not readable, or nothing ran. A rostest leaves two results: rosunit-NAME.xml
with the tests of its test node, and rostest-*.xml with one case `testNAME` that stands for all of them. That case counts
only where it says something new: the node left no result, or it failed though all of its tests passed.
"""

import glob
import os
import sys
import xml.etree.ElementTree as ElementTree


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


def repeats(path, outcome, name, node_results):
    """Whether this case of a rostest only sums up what its test node wrote. node_results: {NAME: set of outcomes}."""
    if not os.path.basename(path).startswith("rostest-"):
        return False
    node = node_results.get(name.rpartition(".test")[2], set())
    return bool(node) and (outcome != "failed" or "failed" in node)


def main(directory):
    """Print the counts; the exit status."""
    counts = {"passed": 0, "failed": 0, "skipped": 0}
    paths = sorted(glob.glob(os.path.join(glob.escape(directory), "**", "*.xml"), recursive=True))
    node_results = {os.path.basename(path)[len("rosunit-"):-len(".xml")]: {outcome for outcome, _ in outcomes(path)}
                    for path in paths if os.path.basename(path).startswith("rosunit-")}
    for path in paths:
        for outcome, name in outcomes(path):
            if repeats(path, outcome, name, node_results):
                continue
            counts[outcome] += 1
            if outcome == "failed":
                print("FAILED %s" % name)
    print("%(passed)d passed, %(failed)d failed, %(skipped)d skipped" % counts, flush=True)
    return 1 if counts["failed"] or not counts["passed"] else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        print("usage: count_test_results.py DIRECTORY", file=sys.stderr)
        sys.exit(2)
    sys.exit(main(sys.argv[1]))
