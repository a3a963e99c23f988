#!/usr/bin/python3
"""Write an rviz configuration for one's own frames and topics; see --help."""

import sys

from vi_ekf_slam.rviz.export import main

if __name__ == "__main__":
    sys.exit(main())
