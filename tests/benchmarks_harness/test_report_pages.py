"""The page, the Markdown and the pictures of made-up results."""

import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import pytest
from report_cases import THREE, finished, paired, results, trial_of

from benchmarks.report import charts, story, writing
from benchmarks.report.laps import Lap
from benchmarks.report.laps import trial_of as trial_of_record
from benchmarks.report.style import looks
from benchmarks.sweeps.suites import paper_suite
from benchmarks.tables.panels import panels

NASTY = "ValueError: <script>alert(1)</script> | `weights` are NaN"
TITLE = "Sweep <i>& more"
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


def no_laps(panel):
    return [
        Lap(name="lap", title="Best", caption="World 0.", animation=b"RIFFwebp", still=b"\x89PNG")
    ]


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    patch = pytest.MonkeyPatch()
    patch.setattr(story, "laps", no_laps)
    out = tmp_path_factory.mktemp("report")
    given = results(
        paired(THREE),
        failures=[(trial_of("x.py:<b>", 3), NASTY)],
        missing=2,
        title=TITLE,
    )
    written = writing.write_report(out, given)
    patch.undo()
    return out, written, given


@pytest.fixture(scope="module")
def page(report):
    return Page((report[0] / "report.html").read_text(encoding="utf-8"))


def test_what_is_returned_is_what_was_written(report):
    out, written, _ = report
    there = {path for path in out.rglob("*") if path.is_file()}
    assert {*written, out / "written.json"} == there
    assert TABLES | {"report.html", "results.md"} <= {path.name for path in there}


def test_the_page_is_well_formed_and_stands_alone(page):
    assert page.open == []
    assert page.count("script") == page.count("link") == page.count("iframe") == 0
    addresses = [
        value
        for _, attributes in page.tags
        for name, value in attributes.items()
        if name in ("src", "srcset", "href", "xlink:href")
    ]
    assert addresses
    assert all(address.startswith(("data:image/", "#")) for address in addresses)
    styles = [attributes.get("style") or "" for _, attributes in page.tags]
    assert not [style for style in styles if re.search(r"url\((?!#)", style)]


def test_ids_are_unique_and_what_is_referred_to_is_there(page):
    ids = [attributes["id"] for _, attributes in page.tags if attributes.get("id")]
    assert len(ids) == len(set(ids))
    for _, attributes in page.tags:
        for name in ("href", "xlink:href"):
            if (attributes.get(name) or "").startswith("#"):
                assert attributes[name][1:] in ids
        for used in re.findall(r"url\(#([^)]*)\)", str(attributes)):
            assert used in ids


def test_every_word_of_others_is_escaped(page):
    words = " ".join(page.words)
    for text in (NASTY, TITLE, "<b>&Mine$x$", "x.py:<b>"):
        assert text in words
    assert page.count("b") == page.count("i") == 0


def test_pictures_have_words_for_those_who_do_not_see_them(page):
    pictures = [attributes for tag, attributes in page.tags if tag in ("svg", "img")]
    assert len(pictures) == 4 + 3 + 1  # charts, a curve over time per method, the animation
    for attributes in pictures:
        assert len(attributes.get("aria-label") or attributes.get("alt") or "") > 10
    assert page.count("title") == 1 + 7


def test_tables_have_captions_and_headings_with_a_scope(page):
    assert page.count("table") == page.count("caption") == 5
    headings = [attributes for tag, attributes in page.tags if tag == "th"]
    assert all(attributes.get("scope") in ("col", "row") for attributes in headings)


def test_the_page_says_what_was_run_how_far_it_came_and_how_to_get_the_same(page):
    words = " ".join(page.words)
    assert "36 of 39 trials finished, 1 failed, 2 not run yet" in words
    assert "deqmcl sweep 'a b.toml' --out there" in words
    assert '"code": "f00d"' in words
    for heading in ("Failed trials", "To get the same", "How to read it", "NEES"):
        assert heading in words


def test_inline_pictures_take_their_colours_from_the_page(page):
    for tag, attributes in page.tags:
        if tag in ("path", "use", "text", "rect"):
            assert not re.search("#[0-9a-f]{6}", attributes.get("style") or "")


def test_pictures_of_the_markdown_are_svg_files_on_white_that_can_be_parsed(report):
    drawings = sorted((report[0] / "images").glob("*.svg"))
    assert len(drawings) == 7
    for path in drawings:
        root = ET.fromstring(path.read_bytes())
        assert root[0].attrib["fill"] == "#ffffff"
        assert "var(--" not in path.read_text(encoding="utf-8")


def test_the_markdown_shows_every_image_that_was_written_and_escapes(report):
    out, _, _ = report
    text = (out / "results.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"\]\(images/([^)]+)\)", text))
    assert shown == {path.name for path in (out / "images").iterdir()}
    assert "<script>" not in text
    assert "<b>" not in text.replace("\\<b\\>", "")


def test_the_same_results_give_the_same_bytes(report, tmp_path, monkeypatch):
    monkeypatch.setattr(story, "laps", no_laps)
    out, written, given = report
    again = writing.write_report(tmp_path, given)
    assert [path.relative_to(tmp_path) for path in again] == [
        path.relative_to(out) for path in written
    ]
    for one, other in zip(written, again, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


def test_a_trial_that_can_not_be_run_again_costs_its_animation_only(tmp_path):
    given = results([finished("gone.py:Gone", i, 1.0) for i in range(2)])
    writing.write_report(tmp_path, given)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "could not be run again" in page
    assert "gone.py:Gone" in page


def test_no_finished_trial_at_all_still_makes_a_report(tmp_path):
    given = results([], failures=[(trial_of("x", 0), "boom")], missing=3)
    writing.write_report(tmp_path, given)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "0 of 4 trials finished, 1 failed, 3 not run yet" in text
    assert "boom" in text


def test_without_the_extra_the_tables_are_written_and_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(writing, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"pip install 'deqmcl-gym\[report\]'"):
        writing.require_report()
    written = writing.write_report(tmp_path, results(paired(THREE)))
    assert {path.name for path in written} == TABLES
    assert {path.name for path in tmp_path.iterdir()} == TABLES | {"written.json"}


def test_every_mark_of_every_chart_is_inside_its_axes(monkeypatch):
    (panel,) = panels(paired(THREE, worlds=40))
    seen = []

    def keep(figure, *, name, **_):
        (axes,) = figure.axes
        (left, right), ends = axes.get_xlim(), sorted(axes.get_ylim())
        marked = [line for line in axes.lines if line.get_marker() not in ("None", "")]
        places = [place for line in marked for place in line.get_xydata().tolist()]
        assert places, name
        assert all(left <= x <= right and ends[0] <= y <= ends[1] for x, y in places), name
        seen.append(name)

    monkeypatch.setattr(charts, "picture", keep)
    look = looks(panel.labels.values())
    for chart in (
        charts.points_chart,
        charts.offset_chart,
        charts.speed_chart,
        charts.calibration_chart,
    ):
        chart(panel, look)
    assert seen == ["points-1", "offsets-1", "speed-1", "calibration-1"]


def test_each_chart_over_time_dashes_the_methods_own_baseline(monkeypatch):
    records = [
        finished(name, w, error, params={"resampler": kind})
        for name, kind, error in (
            ("mcl", "systematic", 10.0),
            ("mcl", "multinomial", 20.0),
            ("deq-mcl", "multinomial", 15.0),
        )
        for w in range(2)
    ]
    (panel,) = panels(records)
    dashed = {}

    def keep(figure, *, title, **_):
        lines = [line for line in figure.axes[0].lines if line.get_linestyle() == "--"]
        dashed[title.rpartition(": ")[2]] = [float(line.get_ydata()[0]) for line in lines]

    monkeypatch.setattr(charts, "picture", keep)
    charts.time_charts(panel, looks(panel.labels.values()))
    assert dashed == {
        "mcl resampler=systematic": [],
        "mcl resampler=multinomial": [],
        "deq-mcl": [20.0],
    }


def test_a_record_names_the_trial_that_made_it():
    (trial,) = paper_suite(
        scenario="paper", localizers=["deq-mcl"], trials=1, seed=3, lag=20, particles=20, beta=2.0
    )
    assert trial_of_record(trial.canonical()) == trial
