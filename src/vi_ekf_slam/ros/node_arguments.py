"""The command line of a node: what ROS takes, and --help, before it waits for a master."""

import argparse

import rospy


def take_ros_arguments(description):
    """Ends the program with 0 where it is asked to explain itself, with 2 at any other argument than those of ROS."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter,
                                     usage="%(prog)s [_PARAMETER:=VALUE ...] [TOPIC:=OTHER ...]")
    parser.parse_args(rospy.myargv()[1:])
