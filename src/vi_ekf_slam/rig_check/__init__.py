"""What is wrong with a rig, found in a recording of it: topics, stamps, units, calibration, clocks, pictures."""
