#!/usr/bin/python3
"""Convert a drive (.npz) to a bag; see --help."""

import sys

from vi_ekf_slam.bag.converter import main

if __name__ == "__main__":
    sys.exit(main())
