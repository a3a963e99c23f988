"""reproduce_paper.py on simulated drives: figures, numbers, the page, refusals."""

import base64
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import yaml
from conftest import HANG_S, ROOT, is_png, program, script

from vi_ekf_slam.evaluation import top_view
from vi_ekf_slam.evaluation.report import ROWS, cell
from vi_ekf_slam.evaluation.run_evaluator import judge_subject
from vi_ekf_slam.evaluation.run_inputs import read_subject
from vi_ekf_slam.paper.figures import METHODS, SIDES, draw_pair, figures_of
from vi_ekf_slam.paper.page import make_page
from vi_ekf_slam.paper.reproducer import make_configurations
from vi_ekf_slam.simulation.simulator import main as simulate

NUMBERS = (1, 2, 4, 5, 7, 8)  # of the figures of 0022 and 0027


def reproduce(*arguments):
    return script("reproduce_paper.py", *arguments)


class Made:
    """What one call made of two drives, 0022 without truth and 0027 with it; 0034 is missing."""

    def __init__(self, folder):
        self.data, self.out = folder / "data & more", folder / "out"
        self.data.mkdir()
        self.out.mkdir()
        for name, duration in (("0022", "12"), ("0027", "40")):
            assert simulate([str(self.data / (name + ".npz")), "--duration", duration, "--quiet"]) == 0
        os.unlink(str(self.data / "0022_truth_left_camera.txt"))
        (self.out / "figure_9_ours.png").write_text("of an earlier call")
        (self.out / "notes.txt").write_text("somebody's")
        self.done = reproduce(self.data, self.out)
        assert self.done.returncode == 0 and self.done.stderr == "", self.done.stderr
        self.text = (self.out / "reproduce_paper.html").read_text(encoding="utf-8")
        self.page = ET.fromstring(self.text)
        self.numbers = json.loads((self.out / "reproduce_paper.json").read_text(encoding="utf-8"))

    def table(self, label):
        """{row's name: [cells]} of the page's table in the region of that label."""
        region = next(e for e in self.page.iter("div") if e.get("aria-label") == label)
        rows = [["".join(c.itertext()) for c in row] for row in region.iter("tr")]
        return {row[0]: row[1:] for row in rows}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return Made(tmp_path_factory.mktemp("paper"))


def test_pictures_of_the_drives_that_are_there(made):
    pictures = ["figure_%d_%s.%s" % (n, s, k) for n in NUMBERS for s in ("paper", "ours") for k in ("png", "svg")]
    others = ["notes.txt", "ours.yaml", "paper_dead_reckoning.yaml", "paper_mapping.yaml", "paper_slam.yaml",
              "reproduce_paper.html", "reproduce_paper.json"]
    assert sorted(os.listdir(str(made.out))) == sorted(pictures + others)  # not figure 9 of the earlier call
    for name in pictures:
        assert is_png(made.out / name) if name.endswith("png") else b"<svg" in (made.out / name).read_bytes()[:1000]
    assert "left out: 0034" in made.done.stdout and "removed: " in made.done.stdout
    assert "Missing: 0034." in "".join(made.page.itertext()) and made.numbers["missing"] == ["0034"]
    assert [e.get("id") for e in made.page.iter("section")] == ["figure-%d" % n for n in NUMBERS]
    headings = [h.text for h in made.page.iter("h3")]
    assert "Fig. 5. Visual Map for dataset0027" in headings and not [h for h in headings if h.startswith("Fig. 6")]


def test_the_page_holds_every_picture_with_an_alternative_text(made):
    images = list(made.page.iter("img"))
    names = ["figure_%d_%s.png" % (n, side) for n in NUMBERS for side in SIDES]
    assert len(images) == len(names) == 12
    for image, name in zip(images, names):
        data = (made.out / name).read_bytes()
        assert base64.b64decode(image.get("src").replace("data:image/png;base64,", "")) == data
        size = int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
        assert (int(image.get("width")), int(image.get("height"))) == size
        assert ("truth" in image.get("alt")) and image.get("alt").startswith("Drive 00")
    assert len({image.get("alt") for image in images}) == 12


def test_the_page_needs_nothing_but_itself(made):
    ids = [e.get("id") for e in made.page.iter() if e.get("id")]
    assert len(ids) == len(set(ids))
    for element in made.page.iter():
        for name in ("src", "href", "srcset", "data", "action", "poster", "background", "style"):
            value = element.get(name, "data:")
            assert value.startswith("data:") or value[0] == "#" and value[1:] in ids, (element.tag, value)
    assert not {e.tag for e in made.page.iter()} & {"script", "iframe", "object", "embed"}
    style = next(made.page.iter("style")).text
    assert "url(" not in style and "@import" not in style and "prefers-color-scheme: dark" in style
    assert "://" not in re.sub(r'base64,[^"]*"', "", self_made(made.text))
    metas = {m.get("name") or m.get("http-equiv"): m.get("content") for m in made.page.iter("meta")}
    assert metas["viewport"] == "width=device-width, initial-scale=1"
    assert metas["Content-Security-Policy"].startswith("default-src 'none'; img-src data:;")


def self_made(text):
    """The page without the configurations, whose comments are not ours to judge."""
    return text[:text.index("<p>The configurations:</p>")]


def test_tables_scroll_by_themselves_and_configurations_are_there(made):
    parents = {child: parent for parent in made.page.iter() for child in parent}
    for table in made.page.iter("table"):
        assert parents[table].get("class") == "scroll" and parents[table].get("tabindex") == "0"
    shown = {d.get("id"): d.find("pre").text for d in made.page.iter("details") if d.get("id")}
    for name in ("ours", "paper_slam", "paper_mapping", "paper_dead_reckoning"):
        assert shown["config-" + name] == (made.out / (name + ".yaml")).read_text(encoding="utf-8")


@pytest.mark.parametrize("method", ["paper_mapping", "paper_slam", "ours_camera_off", "ours_slam"])
def test_the_commands_on_the_page_give_the_numbers_on_the_page(made, tmp_path, method):
    setting = next(p.text for p in made.page.iter("pre") if p.text.startswith("DATA_DIR="))
    commands = next(p.text for p in made.page.iter("pre") if "--output 0027_%s" % method in p.text)
    rosrun = ('rosrun() { if [ "$2" = run_bag ]; then "$run_bag" "${@:3}"; '
              'else "$python" "$scripts/$2" "${@:3}"; fi; }\n')
    done = subprocess.run(["bash", "-e", "-c", rosrun + setting + "\n" + commands + " --no-plots"], cwd=str(tmp_path),
                          env=dict(os.environ, run_bag=program("run_bag"), python=sys.executable,
                                   scripts=os.path.join(ROOT, "scripts")),
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, timeout=HANG_S)
    assert done.returncode == 0, done.stdout
    evaluated = json.loads((tmp_path / ("0027_" + method) / "evaluation.json").read_text(encoding="utf-8"))
    written = made.numbers["drives"]["0027"][method]
    for key in ("slam", "dead_reckoning", "consistency", "frames"):
        assert written[key] == evaluated[key], key
    assert evaluated["slam"]["t_rel_percent"] > 0.0 and evaluated["consistency"]["pose_nees"] > 0.0

    texts = {row[0]: cell(evaluated, row) for row in ROWS if row[0]}
    glance = made.table("Errors for 0027")[METHODS[method].label]
    columns = ["ATE, aligned", "t_rel, 100 to 800 m", "r_rel, 100 to 800 m", "pose NEES, 6 is right"]
    assert glance == [texts[name] for name in columns] and "-" not in glance
    everything, column = made.table("All numbers for 0027"), list(METHODS).index(method)
    assert everything["RPE over 1 frame (m)"][column] == texts["RPE over 1 frame"]
    assert everything["NIS per dof, 1 is right"][column] == texts["NIS per dof, 1 is right"]


def test_numbers_stand_below_their_picture(made):
    ours = made.numbers["drives"]["0027"]["ours_slam"]
    captions = ["".join(c.itertext()) for c in made.page.iter("figcaption")]
    assert "No truth for this drive" in captions[0] and "0022_paper_dead_reckoning" in captions[0]
    assert "ATE, aligned: %.3f m" % ours["slam"]["ate_m"] in captions[-1]
    assert "pose NEES, 6 is right: %.2f" % ours["consistency"]["pose_nees"] in captions[-1]
    assert not {"nan", "None"} & set(" ".join(made.page.itertext()).split())


def test_without_truth_there_are_pictures_and_no_errors(made):
    numbers = made.numbers["drives"]["0022"]
    assert all(data["slam"] is None for data in numbers.values())
    assert numbers["ours_slam"]["frames"]["used_a_frame"] > 0.0 and numbers["ours_camera_off"]["frames"] is None
    assert not [e for e in made.page.iter("div") if e.get("aria-label") == "Errors for 0022"]


def test_the_paper_has_the_values_that_the_page_names():
    texts = make_configurations(os.path.join(ROOT, "config", "default.yaml"))
    modes = {name: yaml.safe_load(text)["paper"]["mode"] for name, text in texts.items() if name != "ours"}
    assert modes == {"paper_dead_reckoning": "dead_reckoning", "paper_mapping": "mapping", "paper_slam": "slam"}
    with open(os.path.join(ROOT, "config", "paper.yaml"), encoding="utf-8") as stream:
        shipped = yaml.safe_load(stream)
    assert yaml.safe_load(texts["paper_slam"]) == shipped
    explanation = figures_of(["0022"])[1].kind.explanation
    assert "a tenth" in explanation and shipped["paper"]["landmark_fraction"] == 0.1
    assert "7e4 px" in explanation and shipped["paper"]["pixel_noise"] ** 0.5 == pytest.approx(7e4, rel=0.02)


def test_both_pictures_of_a_figure_have_one_view_and_one_scale(run, bag):
    from vi_ekf_slam.evaluation.run_inputs import read_bag
    reference = read_bag(bag)
    right = read_subject(str(run), "right", reference)
    right.truth = reference.truth
    bent = read_subject(str(run), "bent", reference)
    bent.poses, bent.truth = right.dead_reckoning[1], reference.truth
    bent.run.landmark_covariances = 100.0 * bent.run.landmark_covariances
    expected = {"dead reckoning": (["truth", "dead reckoning", "start"], ["truth", "camera off", "start"]),
                "visual map": (["truth", "dead reckoning", "start"], ["truth", "SLAM", "start"]),
                "SLAM": (["truth", "dead reckoning", "SLAM", "start"],) * 2}
    for figure in figures_of(["0027"]):
        pictures = draw_pair(figure, [judge_subject(bent), judge_subject(right)])
        axes = [picture.axes[0] for picture in pictures]
        assert axes[0].get_xlim() == axes[1].get_xlim() and axes[0].get_ylim() == axes[1].get_ylim()
        for ax, labels, side in zip(axes, expected[figure.kind.name], SIDES):
            assert ax.get_aspect() == 1.0 and (ax.get_xlabel(), ax.get_ylabel()) == (
                "x, seen from above (m)", "y, seen from above (m)")
            assert [text.get_text() for text in ax.get_legend().get_texts()] == labels
            title = "Fig. %d, 0027: %s, %s\nATE " % (figure.number, figure.kind.name, SIDES[side])
            assert ax.get_title().startswith(title)
        if figure.kind.name != "dead reckoning":
            assert pictures[0].axes[1].get_ylim() == pictures[1].axes[1].get_ylim()  # the bars of the colours


def test_wide_ellipses_are_named_instead_of_drawn():
    circle = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [100.0, 100.0, 0.0]])
    landmarks, covariances = circle + [5.0, 5.0, 0.0], np.tile(300.0 * np.eye(3), (3, 1, 1))
    figure = top_view.draw_trajectories("", [("SLAM", circle, {})], landmarks, np.full(3, 300.0 ** 0.5), covariances)
    notes = [text.get_text() for text in figure.axes[0].texts]
    assert len(notes) == 1 and "3 landmarks\n95 % ellipses reach farther than 4.77 m and are not drawn" in notes[0]


def test_text_from_outside_is_quoted():
    page = make_page([], {}, {"ours": "# a < b & c\n"}, {}, [("DATA_DIR", "/tmp/<it's> & more"), ("OUT_DIR", "/tmp/x")])
    texts = [p.text for p in ET.fromstring(page).iter("pre")]
    assert texts == ["DATA_DIR='/tmp/<it'\"'\"'s> & more'\nOUT_DIR=/tmp/x", "# a < b & c\n"]


@pytest.mark.parametrize("break_it, words", [
    (lambda data, out: [data / "none", out], "none: is not a directory, allowed: one that holds drives"),
    (lambda data, out: [out.parent, out], "holds none of the paper's drives, allowed: at least one of 0022.npz"),
    (lambda data, out: (data / "0034.npz").write_text("x") and [data, out], "0034.npz: not a complete .npz"),
    (lambda data, out: (data / "0022_truth_left_camera.txt").write_text("1 2\n") and [data, out], "left_camera.txt"),
    (lambda data, out: [data, out, "--config", data / "none.yaml"], "none.yaml: cannot be read: No such file"),
    (lambda data, out: (data / "c.yaml").write_text("speed: 3\n") and [data, out, "--config", data / "c.yaml"],
     "c.yaml: "),
    (lambda data, out: out.write_text("x") and [data, out], "out: cannot be made"),
    (lambda data, out: (out / "figure_1_ours.png").mkdir(parents=True) or [data, out], "is not a regular file"),
])
def test_refusals_are_one_line_and_nothing_is_written(tmp_path, break_it, words):
    data, out = tmp_path / "data", tmp_path / "out"
    data.mkdir()
    assert simulate([str(data / "0022.npz"), "--duration", "4", "--quiet"]) == 0
    os.unlink(str(data / "0022_truth_left_camera.txt"))
    arguments = break_it(data, out)
    before = sorted(os.listdir(str(out))) if out.is_dir() else []
    done = reproduce(*arguments)
    assert done.returncode == 2 and done.stderr.startswith("error: ") and words in done.stderr, done.stderr
    assert len(done.stderr.splitlines()) == 1 and "Traceback" not in done.stderr
    assert (sorted(os.listdir(str(out))) if out.is_dir() else []) == before
