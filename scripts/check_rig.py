#!/usr/bin/python3
"""Find what is wrong with a rig of stereo camera and IMU, in a bag or live; see --help."""

import sys

from vi_ekf_slam.rig_check.checker import main

if __name__ == "__main__":
    sys.exit(main())
