#!/usr/bin/python3
"""Draw the maps of several runs side by side; see --help."""

import sys

from vi_ekf_slam.evaluation.map_comparison import main

if __name__ == "__main__":
    sys.exit(main())
