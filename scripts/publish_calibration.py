#!/usr/bin/python3
"""Publish a calibration; the launch file that import_calibration.py writes starts it."""

import sys

from vi_ekf_slam.ros.calibration_publisher import main

if __name__ == "__main__":
    sys.exit(main())
