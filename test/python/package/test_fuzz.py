"""The fuzz targets under libFuzzer for a few seconds each: the corpus and a fixed number of inputs from a fixed seed."""

import os
import shutil
import subprocess

import pytest
from conftest import script_path

TARGETS = ["estimator", "config", "messages", "bag", "map"]
RUNS = 100  # beyond it: scripts/fuzz.sh SECONDS


@pytest.mark.skipif(shutil.which("clang++") is None, reason="NOT RUN: clang++ is not installed")
def test_a_fixed_number_of_inputs_breaks_nothing():
    """The first time the targets are built with AddressSanitizer and UBSan, which takes minutes."""
    done = subprocess.run([script_path("fuzz.sh")], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=1500,
                          universal_newlines=True, env=dict(os.environ, RUNS=str(RUNS)))
    assert done.returncode == 0, done.stdout
    for target in TARGETS:
        assert "%s: " % target in done.stdout and done.stdout.count("nothing broken") == len(TARGETS), done.stdout
