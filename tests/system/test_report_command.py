"""deqmcl report: of a small run, looked at in a browser; for a paper; of several folders."""

import html
import json
import os
import re
import shutil
import subprocess

import cv2
import pytest
from deqmcl_command import METHODS, exit_code, files, lines, lose, python
from sweep_command import report, sweep, tables, write_small

from benchmarks.report.page import write_report
from benchmarks.sweeps.manifest import SCHEMA
from benchmarks.sweeps.results import results_in

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
LOOK = """<script>addEventListener("load", () => {
  const area = e => e.getBoundingClientRect().width * e.getBoundingClientRect().height;
  const lit = color => { const [r, g, b] = color.match(/[\\d.]+/g).map(Number);
    return (0.2126 * r + 0.7152 * g + 0.0722 * b) / 255; };
  parent.document.body.dataset.seen = JSON.stringify({
    inner: innerWidth,
    scroll: document.documentElement.scrollWidth,
    tables: [...document.querySelectorAll("table")].map(t => [t.rows.length, area(t)]),
    images: [...document.images].map(i => [i.naturalWidth, area(i), i.alt]),
    page: lit(getComputedStyle(document.body).backgroundColor),
    words: [...document.querySelectorAll("p, td, th, li, figcaption, dd")]
      .map(e => lit(getComputedStyle(e).color)),
  });
})</script>"""


@pytest.fixture(scope="module")
def reported(small_run, tmp_path_factory):
    folder = shutil.copytree(small_run[1], tmp_path_factory.mktemp("reported") / "results")
    for path in (folder / "report.html", folder / "results.csv"):
        path.unlink()
    assert exit_code("report", folder) == 0
    return folder


@pytest.fixture(scope="module")
def animated(reported, tmp_path_factory):
    """As a sweep writes it: ``deqmcl paper`` draws no laps of its own in the report."""
    folder = shutil.copytree(reported, tmp_path_factory.mktemp("animated") / "results")
    write_report(folder, results_in(folder))
    return folder


def test_a_report_is_written_beside_the_results(reported, small_run):
    assert files(reported) == files(small_run[1])  # as the run itself has written it


def test_the_report_can_be_written_elsewhere_and_is_the_same(reported, tmp_path, capsys):
    assert exit_code("report", reported, "--out", tmp_path) == 0
    assert files(tmp_path).items() <= files(reported).items()
    assert capsys.readouterr().out.startswith("12 of 12 trials finished.\n")


def test_a_page_of_few_megabytes_has_the_whole_laps_of_best_and_worst_world(animated):
    assert (animated / "report.html").stat().st_size < 4e6
    for name in ("best", "median", "worst"):
        (film,) = (animated / "images").glob(f"lap-1-{name}-*.webp")
        read, animation = cv2.imreadanimation(str(film))
        assert read
        assert len(animation.frames) == 204 // 8 + 1 + 1  # and the whole way
        assert animation.frames[0].shape[1] > 2 * 350  # side by side


def test_guided_worlds_of_different_length_are_swept_and_reported_together(tmp_path):
    more = '\n[[vary]]\nscenario = ["paper", "guided"]\n'
    out = tmp_path / "out"
    assert sweep(write_small(tmp_path, more=more), out) == 0
    assert not (out / "report.html").exists()
    assert exit_code("report", out) == 0
    assert (out / "report.html").exists()
    trials = [row for row in lines(out) if row["offset"] == "0"]
    kinds = ("paper", "guided")
    steps = {p: {r["steps_done"] for r in trials if r["scenario"] == p} for p in kinds}
    assert steps["paper"] == {"204"}
    assert len(steps["guided"]) == 2
    assert all(float(row["error"]) > 0 for row in trials)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("{", "is truncated, or not JSON"),
        ("[" * 100_000, "is nested too deeply"),
        ('{"schema": 3}', "an older version"),
        (f'{{"schema": {SCHEMA + 1}}}', "a newer version"),
        (f'{{"schema": {SCHEMA}, "identity": {{"sweep": null}}}}', "expected object, got null"),
    ],
)
def test_a_folder_without_results_is_refused_in_one_sentence(tmp_path, refusal, content, why):
    (tmp_path / "manifest.json").write_text(content)
    refusal(["report", tmp_path], str(tmp_path), why)
    assert [*files(tmp_path)] == ["manifest.json"]


def seen(page, folder, width, dark):
    """What the browser finds on the page, in a frame: a window is never narrower than 500 px."""
    text = page.read_text(encoding="utf-8").replace("</body>", LOOK + "</body>")
    frame = f'<iframe width="{width}" height="2000" srcdoc="{html.escape(text)}"></iframe>'
    looked = folder / "looked.html"
    looked.write_text(f'<body style="color-scheme: light dark">{frame}', encoding="utf-8")
    command = [BROWSER, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    command += [f"--user-data-dir={folder / 'profile'}", f"--window-size={width + 100},2200"]
    command += [f"--blink-settings=preferredColorScheme={0 if dark else 1}"]
    command += ["--virtual-time-budget=5000", "--dump-dom", looked.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    (found,) = re.findall(r'data-seen="([^"]*)"', done.stdout)
    return json.loads(html.unescape(found))


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (390, True)])
def test_a_browser_finds_the_tables_and_pictures_and_can_read_them(animated, tmp_path, width, dark):
    found = seen(animated / "report.html", tmp_path, width, dark)
    assert found["inner"] == width
    assert found["scroll"] <= width  # tables scroll by themselves, the page does not
    rows = [rows for rows, _ in found["tables"]]
    # errors, calibration, detection
    assert rows == [1 + len(METHODS), 1 + 12, 1 + len(METHODS)]
    assert all(area > 10_000 for _, area in found["tables"])
    shown = [image for image in found["images"] if image[1]]
    assert (len(shown), len(found["images"])) == (10, 13)  # the ends of films are for print
    assert all(wide > 300 and area > 20_000 and alt for wide, area, alt in shown)
    assert (found["page"] < 0.2) == dark
    # light words on dark, dark words on light
    assert all((word > 0.4) if dark else (word < 0.45) for word in found["words"])


SWEEP = """
title = "{title}"
scenario = "sharp"
localizers = [{localizers}]
trials = {trials}
params = {{ particles = 20 }}
seed = {seed}
"""
DRIVEN = "[[vary]]\nagent = [{}]\n"
BROKEN = "sweep_command:broken"


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    root, there = tmp_path_factory.mktemp("swept"), {}

    def run(*localizers, trials=2, seed=0, more="", fails=False):
        key = (localizers, trials, seed, more)
        if key not in there:
            file = root / f"s{len(there)}.toml"
            named = ", ".join(name if "{" in name else f'"{name}"' for name in localizers)
            what = {"localizers": named, "trials": trials, "seed": seed}
            file.write_text(SWEEP.format(title=file.stem, **what) + more)
            there[key] = root / file.stem
            assert sweep(file, there[key]) == (3 if fails else 0)
        return there[key]

    return run


def test_a_report_for_a_paper_has_tables_bibtex_and_figures(swept, tmp_path, capsys):
    folder, out = swept("mcl", "mcl-map"), tmp_path / "out"
    made = {"tables.tex", "references.bib"}
    for flag, more in (("--latex", set()), ("--pdf", {"figures"})):
        assert report(folder, "--out", out, flag) == 0
        made |= more
        assert {name.partition("/")[0] for name in files(out / "export")} == made
        assert ("export/figures/points-1.pdf" in capsys.readouterr().out) == (flag == "--pdf")


def test_no_setting_of_matplotlib_that_a_user_has_changes_a_chart(swept, tmp_path):
    folder, style = swept("mcl", "mcl-map"), tmp_path / "matplotlibrc"
    style.write_text("text.usetex: True\nfont.size: 30\nsavefig.bbox: tight\naxes.facecolor: red\n")
    assert report(folder, "--pdf", "--out", tmp_path / "here") == 0
    theirs = {"MATPLOTLIBRC": str(style), "MPLBACKEND": "module://of_a_notebook"}
    command = ("-m", "benchmarks", "report", folder, "--pdf", "--out", tmp_path / "there")
    python(*command, env=os.environ | theirs)
    assert files(tmp_path / "there" / "export") == files(tmp_path / "here" / "export")


def pooled(out, *folders):
    assert report(*folders, "--out", out) == 0
    return tables(out)


def test_folders_are_pooled_as_if_one_sweep_had_run_all_their_methods(swept, tmp_path, capsys):
    parts = [swept("mcl", "mcl-map"), swept("mcl", "dead-reckoning")]
    together = tables(swept("mcl", "mcl-map", "dead-reckoning"))
    capsys.readouterr()
    assert pooled(tmp_path / "pooled", *parts) == together
    assert capsys.readouterr().out.startswith("6 of 6 trials finished.\n")
    assert pooled(tmp_path / "twice", parts[0], parts[0]) == tables(parts[0])


def test_agents_that_drive_in_the_same_worlds_are_pooled_too(swept, tmp_path):
    apart = (swept("mcl", trials=1, more=DRIVEN.format(f'"{one}"')) for one in ("still", "spin"))
    together = swept("mcl", trials=1, more=DRIVEN.format('"still", "spin"'))
    assert pooled(tmp_path / "pooled", *apart) == tables(together)


def test_folders_of_other_worlds_are_not_pooled_which_is_said(swept, tmp_path, refusal):
    first, other = swept("mcl", "mcl-map"), swept("mcl", "mcl-map", seed=7)
    words = f"deqmcl: {other} is not comparable with {first} (seed was 0 and is 7): give"
    refusal(["report", first, other, "--out", tmp_path / "pooled"], words)
    assert not (tmp_path / "pooled").exists()


def test_folders_of_other_code_or_plug_ins_are_not_pooled(swept, tmp_path, refusal):
    first = swept("mcl", BROKEN, fails=True)
    for edit, why in (
        (lambda made: made | {"code": "0" * 64}, f"is '{'0' * 20}"),
        (lambda made: made | {"plug-ins": {BROKEN: "0" * 64}}, f"plug-ins.{BROKEN} was"),
    ):
        other = shutil.copytree(first, tmp_path / "other", dirs_exist_ok=True)
        content = json.loads((first / "manifest.json").read_text())
        content["identity"] = edit(content["identity"])
        (other / "manifest.json").write_text(json.dumps(content))
        lose(other)  # they are of the code that the manifest had
        refusal(["report", first, other, "--out", tmp_path / "pooled"], "not comparable", why)


def test_folders_that_stopped_when_they_were_decided_are_not_pooled(swept, tmp_path, refusal):
    until = {"trials": 20, "more": "[until_decided]\nmargin = 0.5\n"}
    one = swept("mcl", "dead-reckoning", **until)
    refusal(["report", one, one, "--out", tmp_path / "pooled"], "until_decided", "fixed number")


def test_folders_not_complete_or_without_an_own_output_are_not_pooled(swept, tmp_path, refusal):
    first, other = swept("mcl", "mcl-map"), swept("mcl", "dead-reckoning")
    part = shutil.copytree(first, tmp_path / "part")
    lose(part, 0)
    for words, why in (
        ((other, part, "--out", tmp_path / "pooled"), f"{part} lacks 1 of its 4 trials: finish"),
        ((first, other), "give --out DIR"),
        ((first, other, "--out", first), "give --out DIR"),
        ((first, other, "--out", other), f"the output folder {other} holds files"),
    ):
        refusal(["report", *words], why)
    assert not (tmp_path / "pooled").exists()
