"""The page and the pictures of made-up results."""

import os
import re
import subprocess
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser

import pytest
import report_cases
from report_cases import THREE, finished, lines_of, paired, results, trial_of, trials, written

from benchmarks.report import films, tables
from benchmarks.report.films import Animation
from benchmarks.report.page import write_report

NASTY = "ValueError: <script>alert(1)</script> | `weights` are NaN"
TITLE = "Sweep <i>& more"
SHOWN = {"title": "Best", "caption": "World 0.", "runs": {}}
LAP = Animation(name="lap-1-best-0", **SHOWN, webp=b"RIFFwebp", png=b"\x89PNG")
VOID = {"meta", "img", "source", "br"}
TABLES = {"results.csv", "trials.csv", "timings.csv"}


class Page(HTMLParser):
    """Tags with their attributes, and the words outside of style sheets."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.words, self.open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.words.append(data)

    def count(self, tag):
        return sum(name == tag for name, _ in self.tags)


@pytest.fixture(scope="module")
def given():
    failures = [(trial_of("x.py:<b>", 3), NASTY)]
    return results(paired(THREE), failures=failures, missing=2, title=TITLE)


@pytest.fixture(scope="module")
def report(given, tmp_path_factory):
    out = tmp_path_factory.mktemp("report")
    return out, written(out, given, [LAP])


@pytest.fixture(scope="module")
def page(report):
    return Page((report[0] / "report.html").read_text(encoding="utf-8"))


def test_what_is_returned_is_what_was_written(report):
    out, files = report
    assert {*files} == {path for path in out.rglob("*") if path.is_file()}
    assert TABLES | {"report.html"} <= {path.name for path in files}


def test_the_page_is_well_formed_and_stands_alone(page):
    assert page.open == []
    assert page.count("script") == page.count("link") == page.count("iframe") == 0
    named = [one for _, attributes in page.tags for one in attributes.items()]
    addresses = [value for name, value in named if name in ("src", "srcset", "href")]
    assert addresses
    assert all(address.startswith(("data:image/", "#")) for address in addresses)
    assert not [attributes for _, attributes in page.tags if "url(" in attributes.get("style", "")]


def test_ids_are_unique_and_what_is_referred_to_is_there(page):
    ids = [attributes["id"] for _, attributes in page.tags if attributes.get("id")]
    assert len(ids) == len(set(ids))
    addresses = [attributes.get("href") or "" for _, attributes in page.tags]
    assert {one[1:] for one in addresses if one.startswith("#")} <= {*ids}


def test_every_word_of_others_is_escaped(page):
    words = " ".join(page.words)
    for text in (NASTY, TITLE, "<b>&Mine$x$", "x.py:<b>"):
        assert text in words
    assert page.count("b") == page.count("i") == 0


def test_pictures_and_tables_have_words_for_those_who_do_not_see_them(page):
    pictures = [attributes for tag, attributes in page.tags if tag == "img"]
    assert len(pictures) == 2 + 2  # charts, animation and still
    assert all(len(attributes["alt"]) > 10 for attributes in pictures)
    captions = [attributes for tag, attributes in page.tags if attributes.get("class") == "table"]
    assert page.count("table") == len(captions) == 3
    assert page.count("figcaption") == page.count("figure")


def test_the_page_says_how_far_it_came_and_how_to_get_the_same(page):
    words = " ".join(page.words)
    assert "36 of 39 trials finished, 1 failed, 2 missing: this report is partial." in words
    assert "deqmcl sweep 'a b.toml' --out there" in words
    assert '"code": "f00d"' in words


def test_trials_of_other_code_are_not_run_again_which_costs_their_animation_only(tmp_path):
    write_report(tmp_path, results(trials("gone.py:Gone", [1.0, 1.0])))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "No animation: code, libraries or a plug-in were changed since" in page


def test_a_report_written_anew_has_its_animations_and_runs_nothing(given, tmp_path, monkeypatch):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    written(out, given, [LAP])
    monkeypatch.setattr(films, "films_of", lambda panel: [LAP])
    monkeypatch.setattr(films, "filmed", None)
    files = write_report(elsewhere, given, draw=False, of=out)
    for path in files:
        assert path.read_bytes() == (out / path.relative_to(elsewhere)).read_bytes()
    (out / "images" / "lap-1-best-0.png").unlink()
    write_report(elsewhere, given, draw=False, of=out)
    page = (elsewhere / "report.html").read_text(encoding="utf-8")
    assert "No animation: the folder has none of these worlds" in page


def test_a_report_is_written_without_a_finished_trial_and_whatever_its_command_is(tmp_path):
    words = ["deqmcl", "d\udce9", "a b", "new\nline", "it's", "```"]
    none = results([], failures=[(trial_of("x", 0), "boom")], missing=3)
    write_report(tmp_path, replace(none, command=words))
    expected = r"""deqmcl $'d\xe9' 'a b' $'new\x0aline' 'it'"'"'s' '```'"""
    page = unescape((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert f"<pre>{expected}</pre>" in page
    assert "0 of 4 trials finished, 1 failed, 3 missing" in page
    assert "boom" in page
    printing = ["bash", "-c", f"printf '%s\\0' {expected}"]
    shown = subprocess.run(printing, capture_output=True, check=False)
    assert shown.stdout.split(b"\0")[:-1] == list(map(os.fsencode, words))


def cells_of(page):
    bare = re.sub("</?(span|strong)>", "", page)
    for table in re.findall("<table[ >].*?</table>", bare, re.DOTALL):
        lines = re.findall("<tr[^>]*>(.*?)</tr>", unescape(table).replace("\u00a0", " "), re.DOTALL)
        yield [re.findall("<t[hd][^>]*>(.*?)</t[hd]>", one) for one in lines]


def test_the_page_has_the_cells_of_the_tables(report, given):
    shown = list(cells_of((report[0] / "report.html").read_text(encoding="utf-8")))
    (panel,) = given.panels
    for table in (tables.verdict_table(panel), tables.calibration_table(panel)):
        assert [list(table.frame), *lines_of(table)] in shown


def test_every_column_of_a_table_has_the_score_that_it_names():
    scores = {"energy_score": 0.1, "entropy": 0.2, "nees": 0.3, "wall_share": 0.4}
    panel = report_cases.panel_of([finished("mcl", world, 3.0, scores=scores) for world in (0, 1)])
    row = tables.calibration_table(panel).frame.iloc[0]
    titles = ["energy score, px", "entropy, nats", "NEES (3)", "in walls"]
    assert [row[title].partition(" (")[0] for title in titles] == ["0.10", "0.20", "0.3", "40.0 %"]
