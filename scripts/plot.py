#!/usr/bin/python3
"""Draw runs, the maps of several runs, or what monte_carlo wrote; see --help."""

import sys

from vi_ekf_slam.evaluation.plots import main

if __name__ == "__main__":
    sys.exit(main())
