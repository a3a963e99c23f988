#!/usr/bin/python3
"""Convert a drive (.npz) to a bag with fewer features, gaps or traffic; see --help."""

import sys

from vi_ekf_slam.bag.degrader import main

if __name__ == "__main__":
    sys.exit(main())
