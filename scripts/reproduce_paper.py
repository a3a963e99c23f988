#!/usr/bin/python3
"""Figures 1 to 9 of the paper, and the same with the default filter, as one HTML page; see --help."""

import sys

from vi_ekf_slam.paper.reproducer import main

if __name__ == "__main__":
    sys.exit(main())
