#!/usr/bin/python3
"""Judge runs of run_bag or trajectory files: table, evaluation.json and pictures; see --help."""

import sys

from vi_ekf_slam.evaluation.run_evaluator import main

if __name__ == "__main__":
    sys.exit(main())
