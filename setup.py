"""Installs the Python half of the package; run by catkin, not by hand."""

from setuptools import setup

from catkin_pkg.python_setup import generate_distutils_setup

setup(**generate_distutils_setup(packages=["vi_ekf_slam"], package_dir={"": "src"}))
