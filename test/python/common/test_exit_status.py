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
