#!/usr/bin/python3
"""Picture of a bag in rviz, without a screen; see --help."""

import sys

from vi_ekf_slam.rviz.renderer import main

if __name__ == "__main__":
    sys.exit(main())
