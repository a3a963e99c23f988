"""What the documentation names exists: links, files, programs with their options, launch files with their arguments, keys, tests."""

import os
import re
import subprocess
import xml.etree.ElementTree as ElementTree

import pytest
import yaml
from conftest import HANG_S, ROOT, program, script, script_path

PAGES = ["README.md"] + ["docs/" + name for name in sorted(os.listdir(os.path.join(ROOT, "docs"))) if name.endswith(".md")]
README_LINES = 80  # one screen
FOLDERS = ("cfg", "config", "docs", "include", "launch", "msg", "rviz", "scripts", "src", "srv", "test", ".ci")
NO_KEYS = {("front_end", "image")}  # a topic
FILE_ENDS = {"bag", "cpp", "hpp", "launch", "msg", "npz", "png", "py", "srv", "txt", "yaml"}
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
CODE = re.compile(r"`([^`\n]+)`")


def read(path):
    with open(os.path.join(ROOT, path), encoding="utf-8") as stream:
        return stream.read()


def prose(page):
    """The page without its blocks of code."""
    return re.sub(r"(?ms)^```.*?^```", "", read(page))


def commands(page):
    """Commands of the page: lines of its blocks of shell, continued lines joined, comments cut; and inline code."""
    blocks = re.findall(r"(?ms)^```bash\n(.*?)^```", read(page))
    lines = [line.split(" #")[0].strip() for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    joined = CODE.findall(re.sub(r"(`[^`\n]*)\n\s*([^`\n]*`)", r"\1 \2", prose(page)))
    return [line for line in lines if line and not line.startswith("#")] + joined


def anchors(page):
    """Anchors of the page's headings, as GitHub makes them."""
    headings = re.findall(r"(?m)^#+ +(.*?) *$", re.sub(r"(?ms)^```.*?^```", "", read(page)))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def links(page):
    """(link, path below the root or None for another site, anchor or '') of the page."""
    found = []
    for link in LINK.findall(read(page)):
        if not re.match(r"[a-z]+:", link):
            path, _, anchor = link.partition("#")
            found.append((link, os.path.normpath(os.path.join(os.path.dirname(page), path)) if path else page, anchor))
    return found


def repository_files():
    """Paths below the root of what belongs to the package."""
    return [os.path.relpath(os.path.join(folder, name), ROOT) for top in FOLDERS
            for folder, _, names in os.walk(os.path.join(ROOT, top)) for name in names]


def test_there_are_pages_commands_and_links():
    assert len(PAGES) > 10 and sum(len(commands(p)) for p in PAGES) > 300 and sum(len(links(p)) for p in PAGES) > 80


def test_the_readme_is_one_screen():
    assert len(read("README.md").splitlines()) <= README_LINES


@pytest.mark.parametrize("page", PAGES)
def test_links_resolve(page):
    for link, path, anchor in links(page):
        assert os.path.exists(os.path.join(ROOT, path)), link
        if anchor:
            assert anchor in anchors(path), "%s: allowed: %s" % (link, ", ".join(sorted(anchors(path))))


def test_every_page_is_linked_from_the_readme():
    assert {path for _, path, _ in links("README.md")} >= set(PAGES) - {"README.md"}


def named_files(page):
    """Words in the page's inline code that look like files of the repository."""
    ends = r"(?:py|cpp|hpp|sh|md|svg|launch|xml|yaml|rviz|msg|srv|cfg|rst)"
    for code in CODE.findall(prose(page)):
        for word in re.findall(r"[\w./{},-]+\." + ends + r"(?![\w.])", code):
            yield word


@pytest.mark.parametrize("page", PAGES)
def test_files_exist(page):
    files = repository_files()
    names = {os.path.basename(path) for path in files}
    for word in named_files(page):
        first = word.split("/")[0]
        if "/" in word and first in FOLDERS:
            assert word in files, word
        elif re.match(r"(test_\w+\.py|\w+_test\.(py|cpp))$", os.path.basename(word)) or word.endswith((".msg", ".srv")):
            assert os.path.basename(word) in names, word
        elif page == "docs/architecture.md" and word.endswith((".cpp", ".hpp")):
            assert any(path.endswith("/" + word) for path in files), word


def help_of(name):
    """What a program of the package prints for --help."""
    if name.endswith(".py"):
        kinds = {"plot.py": ("run", "maps", "monte_carlo"), "simulate_dataset.py": ("--images",)}
        return "".join(script(name, *kind, "--help").stdout for kind in [()] + [(kind,) for kind in kinds.get(name, ())])
    return subprocess.run([program(name), "--help"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True,
                          timeout=HANG_S).stdout


def test_programs_and_their_options_exist():
    used = {}
    for page in PAGES:
        for command in commands(page):
            for name, arguments in re.findall(r"(?:rosrun vi_ekf_slam |^)([\w.]+)((?: [^|;&]*)?)", command):
                is_ours = command.startswith("rosrun vi_ekf_slam ") or os.path.exists(script_path(name)) or name == "run_bag"
                if is_ours and name.endswith((".py", "run_bag", "monte_carlo", "slam_node", "front_end", "soak")):
                    used.setdefault(name, set()).update(re.findall(r"(?<!\S)--[a-z][a-zA-Z-]*", arguments))
    assert {"dataset_to_bag.py", "evaluate.py", "run_bag", "import_calibration.py", "monte_carlo"} <= set(used)
    for name, options in used.items():
        assert os.path.exists(script_path(name)) if name.endswith(".py") else program(name), name
        if options - {"--help"}:
            text = help_of(name)
            missing = [option for option in options - {"--help"} if not re.search(re.escape(option) + r"(?![\w-])", text)]
            assert not missing, "%s: %s" % (name, ", ".join(missing))


def test_programs_of_other_packages_that_are_named_are_installed():
    from roslib.packages import find_node
    named = {pair for page in PAGES for pair in re.findall(r"rosrun (?!vi_ekf_slam )([a-z]\w*) (\w+)", read(page))}
    assert {package for package, _ in named} >= {"tf", "tf2_ros"}
    assert not [pair for pair in named if not find_node(*pair)]


@pytest.mark.parametrize("page", PAGES)
def test_scripts_of_the_checkout_exist(page):
    for command in commands(page):
        for name in re.findall(r"(?<![\w/])(?:\./)?scripts/([\w.]+\.(?:sh|py))", command):
            assert os.access(script_path(name), os.X_OK), command


@pytest.mark.parametrize("page", PAGES)
def test_launch_files_and_their_arguments_exist(page):
    def arguments(name):
        tree = ElementTree.parse(os.path.join(ROOT, "launch", name))
        return {tag.get("name") for tag in tree.getroot().iter("arg") if tag.get("value") is None}
    for command in commands(page):
        for name, words in re.findall(r"roslaunch(?: --ros-args)? vi_ekf_slam ([\w.]+\.launch)([^|;&]*)", command):
            known = arguments(name) | arguments("slam.launch")
            assert not set(re.findall(r"(\w+):=", words)) - known, command


@pytest.mark.parametrize("page", PAGES)
def test_keys_of_the_configuration_exist(page):
    sections = {}
    for name in ("default", "expert", "paper"):
        for section, keys in yaml.safe_load(read("config/%s.yaml" % name)).items():
            if isinstance(keys, dict):
                sections.setdefault(section, set()).update(keys)
    for code in CODE.findall(prose(page)):
        for section, key in re.findall(r"(?<![\w/.~-])([a-z_]+)[/.]([a-z_]+)(?=$|[:\s,])", code):
            if section in sections and key not in FILE_ENDS and (section, key) not in NO_KEYS:
                assert key in sections[section], code


def gtests():
    """{suite: set of names} of all gtests."""
    found = {}
    for path in repository_files():
        if path.startswith("test/") and path.endswith((".cpp", ".hpp")):
            for suite, name in re.findall(r"TEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\)", read(path)):
                found.setdefault(suite, set()).add(name)
    return found


@pytest.mark.parametrize("page", PAGES)
def test_gtests_exist(page):
    found = gtests()
    assert len(found) > 50
    for code in CODE.findall(prose(page)):
        for suite, name in re.findall(r"^([A-Z]\w+)\.(\*|\w+)(?:\.\.\.)?$", code):
            if name in FILE_ENDS:
                continue
            assert suite in found, code
            assert name == "*" or any(known.startswith(name) for known in found[suite]), code
