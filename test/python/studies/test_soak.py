"""A short soak: an hour and twenty minutes of sensor time through the node's own way. scripts/nightly.sh soak drives a day."""

import re
import subprocess

from conftest import HANG_S, program


def test_memory_does_not_grow_and_no_pose_is_missing(tmp_path):
    frames = 48000
    # As many features as a day's soak has: with fewer, the archive would not be full after two thirds of it.
    done = subprocess.run([program("soak"), "--frames", str(frames), "--output", str(tmp_path)],
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, timeout=HANG_S)
    assert done.returncode == 0, done.stdout
    assert "%d frames in" % frames in done.stdout and done.stdout.rstrip().endswith("0 problems"), done.stdout
    growth = float(re.search(r"([+-][\d.]+) % in the last third", done.stdout).group(1))
    assert growth < 5.0
    assert sum(1 for _ in open(str(tmp_path / "trajectory.tum"))) == frames


def test_says_what_it_does_not_understand():
    done = subprocess.run([program("soak"), "--frames", "0"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          universal_newlines=True, timeout=HANG_S)
    assert done.returncode == 1
    assert "--frames is '0', allowed: a whole number from 1 to" in done.stdout
