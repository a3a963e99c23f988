"""scripts/studies/growth_table.py: its table, and what is no report."""

import json
import os

import pytest
from conftest import script

NAME = os.path.join("studies", "growth_table.py")


def test_a_case_is_a_row(tmp_path):
    case = {"name": "grow/active:25/inactive:%d/iterations:1", "real_time": 0.5, "median_ms": 0.4, "worst_ms": 2.0, "map_mb": 7.0, "peak_mb": 17.0}
    cases = [dict(case, name=case["name"] % 5000, real_time=0.75), dict(case, name=case["name"] % 500)]
    (tmp_path / "report.json").write_text(json.dumps({"benchmarks": cases}))
    lines = script(NAME, "--json", tmp_path / "report.json").stdout.splitlines()
    assert lines[2] == "| 25 | 500 | 0.50 ms | 0.40 ms | 2 ms | 7 MB | 17 MB |" and lines[-1] == "25 in view: 1.50 (1.00)"


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"benchmarks": [{"name": "x"}]}'])
def test_what_is_no_report_is_named(tmp_path, text):
    path = tmp_path / "report.json"
    path.write_text(text)
    done = script(NAME, "--json", path)
    assert done.returncode == 2 and done.stderr == "error: %s is none, allowed: a report of growth_benchmark\n" % path
