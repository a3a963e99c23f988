"""Take a drive through run_bag and judge the result: conversion, run and errors in one place, for tests and studies."""

import os
import subprocess
from collections import namedtuple

import numpy as np

from vi_ekf_slam.bag.reader import read_reference
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.package_files import package_program
from vi_ekf_slam.dataset.truth import sample_poses
from vi_ekf_slam.evaluation.against_truth import evaluate
from vi_ekf_slam.evaluation.run_inputs import of_body
from vi_ekf_slam.evaluation.run_io import read_run

Judgement = namedtuple("Judgement", "slam dead_reckoning way")
Judgement.__doc__ = """slam, dead_reckoning: against_truth.Evaluation. way: length of the true path in m."""


def run_bag(bag, config, output, *options):
    """Run run_bag on `bag` with the file `config` into the directory `output`; InputError with its complaint. What it warns of."""
    done = subprocess.run([package_program("run_bag"), bag, "--config", config, "--output", output, "--quiet", *options],
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, universal_newlines=True, check=False)
    if done.returncode != 0:
        raise InputError("%s: %s" % (os.path.basename(bag), done.stderr.strip() or "run_bag failed"))
    return done.stderr


def judge(bag, output):
    """The errors of a run of run_bag against the truth and with the extrinsic that its bag carries."""
    reference = read_reference(bag)
    if reference.truth is None:
        raise InputError("%s: has no truth" % bag)
    run = read_run(output)
    truth, cam_T_imu = of_body(reference.truth, reference, run.summary)
    slam, dead = (evaluate(stamps, poses, truth, cam_T_imu)
                  for stamps, poses in ((run.stamps, run.poses), (run.dead_stamps, run.dead_poses)))
    _, true_poses = sample_poses(*truth, run.stamps)
    return Judgement(slam, dead, float(np.linalg.norm(np.diff(true_poses[:, :3, 3], axis=0), axis=1).sum()))
