#!/usr/bin/python3
"""Draw what the program monte_carlo wrote; see --help."""

import sys

from vi_ekf_slam.simulation.monte_carlo_plotter import main

if __name__ == "__main__":
    sys.exit(main())
