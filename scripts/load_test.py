#!/usr/bin/python3
"""400 Hz IMU and 30 Hz x 300 features through the node's topics; see --help."""

import sys

from vi_ekf_slam.ros.load_test import main

if __name__ == "__main__":
    sys.exit(main())
