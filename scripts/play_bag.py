#!/usr/bin/python3
"""Play a bag for slam_node and end the node when it has answered all of it; slam.launch starts it with bag:=FILE."""

import sys

from vi_ekf_slam.ros.bag_player import main

if __name__ == "__main__":
    sys.exit(main())
