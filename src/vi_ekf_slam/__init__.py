"""Python half of vi_ekf_slam: datasets, bags, evaluation and pictures."""
