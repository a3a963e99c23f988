#!/usr/bin/env python3
"""A node that comes back closes the loop: the event, the path that is corrected as a whole, and what must not jump."""

import math
import os
import sys

import rostest
from nav_msgs.msg import Odometry, Path
from visualization_msgs.msg import Marker, MarkerArray

import drive_data
from node_runner import START, WITHOUT_SLIP, NodeRunner
from vi_ekf_slam.msg import LoopClosure

LAP = 2.0 * math.pi / drive_data.YAW_RATE  # s


class Loops(NodeRunner):
    """A circle and a fifth of it again, by ids that return."""

    name = "slam_loops"

    def test_a_loop_corrects_the_path_as_a_whole(self):
        """What the topics say of it agrees with each other and with what is saved."""
        loops, paths = self.listen("loop_closures", LoopClosure), self.listen("path", Path)
        markers, dead = self.listen("landmarks", MarkerArray), self.listen("dead_reckoning/odometry", Odometry)
        end = 1.2 * LAP
        node = self.start_node(output_dir=self.output, map={"keep": "all"}, invariant=WITHOUT_SLIP)
        self.play(0.0, end)
        self.answered(START + math.floor(10.0 * end) / 10.0 - 0.05)
        self.wait_for(lambda: loops and paths[-1].header.stamp >= loops[0].header.stamp)
        loop = loops[0]
        self.assertEqual(("map", drive_data.IMU), (loop.header.frame_id, loop.child_frame_id))
        self.assertGreaterEqual(loop.landmarks, 3)
        self.assertLess(loop.before.to_sec() - START, 10.0, "the beginning of the drive is what was found again")
        # The relative pose is the one that was driven, within what is said of it.
        first, second = (drive_data.pose_at(stamp.to_sec() - START) for stamp in (loop.before, loop.header.stamp))
        ahead, left = second[0] - first[0], second[1] - first[1]
        driven = (math.cos(first[2]) * ahead + math.sin(first[2]) * left,
                  -math.sin(first[2]) * ahead + math.cos(first[2]) * left)
        pose, covariance = loop.pose.pose.position, loop.pose.covariance
        for axis, (said, true) in enumerate(zip((pose.x, pose.y), driven)):
            deviation = math.sqrt(covariance[7 * axis])
            self.assertGreater(deviation, 0.0)
            self.assertLess(abs(said - true), 0.05 + 4.0 * deviation)
        lines = [m for array in markers for m in array.markers if m.ns == "loop_closures" and m.action == Marker.ADD]
        self.assertTrue(lines and len(lines[-1].points) >= 2, "no line between the ends of the loop")
        steps = [math.hypot(b.pose.pose.position.x - a.pose.pose.position.x, b.pose.pose.position.y - a.pose.pose.position.y)
                 for a, b in zip(dead, dead[1:])]
        self.assertLess(max(steps), 0.5, "the odometry jumps")
        node.terminate()
        self.assertEqual(0, node.wait(20))
        self.wait_for(lambda: paths[-1].header.stamp.to_sec() >= START + end - 1.0)
        causal, smoothed = self.saved("trajectory.tum"), self.saved("trajectory_smoothed.tum")
        self.assertEqual(sorted(causal), sorted(smoothed))
        moved = max(math.dist(causal[stamp], smoothed[stamp]) for stamp in causal)
        self.assertGreater(moved, 0.01, "the loop has moved nothing")
        # The path that was published last is corrected by the last loop, the file by what came after it too.
        published = {p.header.stamp.to_nsec(): (p.pose.position.x, p.pose.position.y, p.pose.position.z)
                     for p in paths[-1].poses}
        early = [stamp for stamp in published if stamp in smoothed and stamp < loop.header.stamp.to_nsec()]
        self.assertGreater(len(early), 50)
        self.assertLess(max(math.dist(published[s], smoothed[s]) for s in early), 0.1 * moved + 0.01)

    def saved(self, name):
        """Positions of a trajectory by stamp (ns)."""
        positions = {}
        with open(os.path.join(self.output, name), encoding="ascii") as file:
            for line in file:
                stamp, *numbers = line.split()
                seconds, nanoseconds = stamp.split(".")
                positions[int(seconds) * 10**9 + int(nanoseconds)] = tuple(float(n) for n in numbers[:3])
        return positions


if __name__ == "__main__":
    rostest.rosrun("vi_ekf_slam", "loops", Loops, sys.argv)
