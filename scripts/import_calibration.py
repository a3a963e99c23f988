#!/usr/bin/python3
"""Make a launch file or a bag of a calibration as Kalibr, camera_calibration, EuRoC and KITTI write it; see --help."""

import sys

from vi_ekf_slam.recordings.calibration_importer import main

if __name__ == "__main__":
    sys.exit(main())
