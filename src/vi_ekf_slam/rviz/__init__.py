"""The real rviz: its configuration, what there is to show, and pictures of it."""
