"""Drives in the course's .npz files and the poses beside them: read, check, repair and make worse."""
