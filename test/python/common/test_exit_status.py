"""How programs end."""

import os
import subprocess
import sys

import pytest


@pytest.mark.parametrize("lines", [1, 100000])  # within what is buffered, and beyond
def test_nothing_is_said_where_nobody_reads(lines):
    reader, writer = os.pipe()
    os.close(reader)
    program = "import sys; from vi_ekf_slam.common.exit_status import exit_status; sys.exit(exit_status(print, %d * 'line\\n'))"
    done = subprocess.run([sys.executable, "-c", program % lines], stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")


def test_a_name_that_the_terminal_cannot_show_is_shown_as_its_numbers():
    program = "import sys; from vi_ekf_slam.common.exit_status import exit_status; sys.exit(exit_status(print, 'caf\\xe9'))"
    done = subprocess.run([sys.executable, "-c", program], env=dict(os.environ, PYTHONIOENCODING="ascii"), stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"caf\\xe9\n", b"")
