"""The package as a whole: what catkin_lint says about it, and what its files must be."""

import os
import re
import shutil
import subprocess
import sys
from fnmatch import fnmatch

import pytest
from conftest import HANG_S, ROOT, script, script_path


def read(*path):
    with open(os.path.join(ROOT, *path), encoding="utf-8") as stream:
        return stream.read()


@pytest.mark.skipif(shutil.which("catkin_lint") is None, reason="NOT RUN: catkin_lint is not installed")
def test_catkin_lint_is_clean(tmp_path):
    package = tmp_path / "vi_ekf_slam"  # a checkout may have any name, a package's folder may not
    package.symlink_to(ROOT)
    environment = {key: value for key, value in os.environ.items() if key != "ROS_PACKAGE_PATH"}  # names the checkout
    done = subprocess.run(["catkin_lint", "--strict", "-W2", "--offline", str(package)], stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, universal_newlines=True, timeout=HANG_S, env=environment)
    assert done.returncode == 0, done.stdout


def test_versions_agree():
    """The changelog's newest is that of package.xml, as catkin's release tools ask for."""
    version = re.search(r"<version>([\d.]+)</version>", read("package.xml")).group(1)
    assert re.search(r"(?m)^(\d+\.\d+\.\d+)", read("CHANGELOG.rst")).group(1) == version


@pytest.mark.skipif(shutil.which("doxygen") is None, reason="NOT RUN: doxygen is not installed")
def test_doxygen_has_no_warning(tmp_path):
    configuration = read("Doxyfile") + "\nOUTPUT_DIRECTORY = %s\n" % tmp_path
    done = subprocess.run(["doxygen", "-"], input=configuration, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, cwd=ROOT,
                          universal_newlines=True, timeout=HANG_S)
    assert done.returncode == 0 and done.stdout == "" and (tmp_path / "html" / "index.html").exists(), done.stdout


def test_every_python_file_compiles_with_the_oldest_supported_version():
    """Ubuntu 20.04 has Python 3.8: syntax of later versions must not creep in."""
    import ast
    for folder in ("scripts", os.path.join("src", "vi_ekf_slam"), os.path.join("test", "python"), os.path.join("test", "ros")):
        paths = [os.path.join(below, name) for below, _, names in os.walk(os.path.join(ROOT, folder)) for name in names]
        sources = [path for path in paths if path.endswith(".py")]
        assert len(sources) > 5, folder
        for path in sources:
            ast.parse(read(path), path, feature_version=(3, 8))
    assert sys.version_info >= (3, 8)


def test_pytest_at_the_root_collects_the_python_tests_alone(pytestconfig):
    """All of them, and none of the rostests, which need a master."""
    assert str(pytestconfig.inipath) == os.path.join(ROOT, "pytest.ini")
    assert pytestconfig.getini("testpaths") == ["test/python"] and pytestconfig.getini("python_files") == ["test_*.py"]
    there = [os.path.relpath(os.path.join(below, name), ROOT)
             for below, _, names in os.walk(os.path.join(ROOT, "test")) for name in names
             if name.startswith("test_") and name.endswith(".py")]
    assert len(there) > 40 and [path for path in there if not path.startswith("test/python/")] == []
    assert len({os.path.basename(path) for path in there}) == len(there)  # of two of one name, in no package, it takes none
    skipped = pytestconfig.getini("norecursedirs")
    assert not [path for path in there for folder in path.split("/")[:-1] for pattern in skipped if fnmatch(folder, pattern)]


def test_every_folder_of_modules_is_a_package():
    """What has no __init__.py is found in the devel space and forgotten by the installation (find_packages in setup.py)."""
    folders = [(below, names) for below, _, names in os.walk(os.path.join(ROOT, "src", "vi_ekf_slam"))
               if any(name.endswith(".py") for name in names)]
    assert len(folders) > 5
    assert [below for below, names in folders if "__init__.py" not in names] == []


CASE = '<testcase classname="%s" name="%s">%s</testcase>'
FAILURE = "<failure/>"


@pytest.mark.parametrize("files, printed", [
    ({}, "0 passed, 0 failed, 0 skipped"),
    ({"gtest-a": [("a", "x", ""), ("a", "y", "<skipped/>")]}, "1 passed, 0 failed, 1 skipped"),
    ({"rostest-a": [("rostest.runner.RosTest", "testnode", "")], "rosunit-node": [("N", "x", ""), ("N", "y", "")]},
     "2 passed, 0 failed, 0 skipped"),
    ({"rostest-a": [("rostest.runner.RosTest", "testnode", FAILURE)], "rosunit-node": [("N", "x", ""), ("N", "y", FAILURE)]},
     "1 passed, 1 failed, 0 skipped"),
    ({"rostest-a": [("rostest.runner.RosTest", "testnode", FAILURE)], "rosunit-node": [("N", "x", "")]},
     "1 passed, 1 failed, 0 skipped"),
    ({"rostest-a": [("rostest.runner.RosTest", "testnode", FAILURE)]}, "0 passed, 1 failed, 0 skipped")])
def test_results_count_once(tmp_path, files, printed):
    for name, cases in files.items():
        (tmp_path / (name + ".xml")).write_text("<testsuite>%s</testsuite>" % "".join(CASE % case for case in cases))
    done = script("count_test_results.py", tmp_path)
    assert done.stdout.splitlines()[-1] == printed
    assert done.returncode == (0 if " 0 failed" in printed and not printed.startswith("0 passed") else 1)


def test_without_a_directory_the_count_says_how_it_is_used():
    done = script("count_test_results.py")
    assert done.returncode == 2 and done.stderr == "usage: count_test_results.py DIRECTORY\n"


def shell(name, *arguments, **environment):
    """One of the shell scripts at its end, with at most what its first checks take: none of these cases builds anything."""
    return subprocess.run([script_path(name)] + [str(a) for a in arguments], env=dict(os.environ, **environment), timeout=HANG_S,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)


@pytest.mark.parametrize("arguments", [("demo.sh",), ("nightly.sh",), ("nightly.sh", "plain"), ("setup.sh",), ("test.sh",)])
def test_shell_scripts_explain_themselves(arguments):
    """And do nothing else: without it --help of test.sh ran all tests."""
    done = shell(*arguments, "--help")
    comment = read("scripts", arguments[0]).split("\n\n", 1)[0].splitlines()[1:]
    assert done.returncode == 0 and done.stdout.splitlines() == [line[2:] for line in comment if line.startswith("#")]


@pytest.mark.parametrize("name", ["setup.sh", "test.sh"])
def test_shell_scripts_overlook_no_argument(name):
    done = shell(name, "core")
    assert done.returncode == 1 and done.stdout == "error: %s takes no arguments, given: core; see --help\n" % name


def test_the_demo_refuses_what_it_cannot_play(tmp_path):
    bag = tmp_path / "drive.bag"
    bag.write_bytes(b"")
    done = shell("demo.sh", bag)
    assert done.returncode == 1 and done.stdout.startswith("error: %s: is a bag already, play it by: roslaunch " % bag)
    for rate in ("fast", "0", "0.0", "-1", "."):
        done = shell("demo.sh", RATE=rate)
        assert done.returncode == 1 and done.stdout == "error: RATE is '%s', allowed: a positive number\n" % rate
