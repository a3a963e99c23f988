"""Simulated drives with pictures: a scene of textured rectangles, a smooth motion, and a stereo camera with an IMU in it."""
