"""Recorded drives with an IMU and stereo images or features, in their own formats: read and checked."""
