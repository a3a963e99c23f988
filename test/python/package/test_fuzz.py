"""scripts/nightly.sh fuzz, and the gtests that replay its corpus with every test run, know the same targets."""

import os
import subprocess

import pytest
from conftest import HANG_S, ROOT, program, script_path

CORPUS = os.path.join(ROOT, "test", "fuzz", "corpus")


def fuzz(*arguments):
    """The script, finished: (status, what it said)."""
    done = subprocess.run([script_path("nightly.sh"), "fuzz"] + list(arguments), stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, timeout=HANG_S, universal_newlines=True)
    return done.returncode, done.stdout


def test_what_is_no_target_or_time_is_refused():
    """By name, with what is allowed, and before anything is built."""
    status, said = fuzz("1", "nonsense")
    assert status == 1 and "'nonsense'" in said and "building" not in said
    known = said.rsplit("known are: ", 1)[1].strip().split(", ")
    assert sorted(known) == sorted(os.listdir(CORPUS))
    status, said = fuzz("soon")
    assert status == 1 and "SECONDS is 'soon', allowed: a whole number" in said


@pytest.mark.parametrize("target", sorted(os.listdir(CORPUS)))
def test_each_corpus_is_replayed(target):
    """By a gtest of its own, which is built without clang."""
    tests = subprocess.run([program("fuzz_%s_test" % target), "--gtest_list_tests"], stdout=subprocess.PIPE, timeout=HANG_S,
                           universal_newlines=True, check=True)
    assert "Corpus" in tests.stdout
    assert os.listdir(os.path.join(CORPUS, target))
