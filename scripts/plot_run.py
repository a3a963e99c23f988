#!/usr/bin/python3
"""Draw a run of run_bag and print its errors; see --help."""

import sys

from vi_ekf_slam.evaluation.run_plotter import main

if __name__ == "__main__":
    sys.exit(main())
