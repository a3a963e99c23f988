#!/usr/bin/python3
"""Simulate a drive as a dataset (.npz) with its truth; see --help."""

import sys

from vi_ekf_slam.simulation.simulator import main

if __name__ == "__main__":
    sys.exit(main())
