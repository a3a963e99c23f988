#!/usr/bin/python3
"""Record what slam_node publishes; slam.launch starts it with record:=true."""

import sys

from vi_ekf_slam.ros.output_recorder import main

if __name__ == "__main__":
    sys.exit(main())
