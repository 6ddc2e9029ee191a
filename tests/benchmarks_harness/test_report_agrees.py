"""The page and the Markdown tell the numbers of the tables (test_any_sweep: of results.csv)."""

import re
from html import unescape

import pytest
from report_cases import finished, lines_of, paired, panel_of, panels_of, parsed, results, written

from benchmarks.report import tables
from benchmarks.trials.scoring import SCORE_NAMES

BASELINE = "mcl-map"  # neither the usual one nor the first
TABLES = tables.verdict_table, tables.calibration_table


@pytest.fixture(scope="module")
def reported(tmp_path_factory):
    """The folder of a report, and its records."""
    records = paired({"ekf": (18.5, (0,)), "grid": (10.0, (0,))})  # have no particles
    for n, shift in ((300, 0.0), (100, 3.0)):
        methods = {"mcl": (20.0 + shift, (0,)), BASELINE: (17.0 + shift, (0, -20))}
        records = paired(methods, params={"particles": n}) + records
    out = tmp_path_factory.mktemp("agree")
    written(out, results(records, baseline=BASELINE))
    return out, records


def of_html(text):
    """The cells of each table, line by line."""
    for table in re.findall(
        "<table[ >].*?</table>", re.sub("</?(span|strong)>", "", text), re.DOTALL
    ):
        lines = re.findall("<tr[^>]*>(.*?)</tr>", unescape(table).replace("\u00a0", " "), re.DOTALL)
        yield [re.findall("<t[hd][^>]*>(.*?)</t[hd]>", one) for one in lines]


def of_markdown(text):
    """The same of the Markdown."""
    for block in text.split("\n\n"):
        if block.startswith("|"):
            cells = re.sub(r"\*\*|\\", "", block).splitlines()
            lines = [[c.strip() for c in one.strip("|").split("|")] for one in cells]
            yield [lines[0], *lines[2:]]


@pytest.mark.parametrize(
    ("name", "tables_of"), [("report.html", of_html), ("results.md", of_markdown)]
)
def test_page_and_markdown_have_the_cells_of_the_tables_whose_numbers_are_those_of_results_csv(
    reported, name, tables_of
):
    folder, records = reported
    rows = parsed((folder / "results.csv").read_text())
    assert {row["baseline"] for row in rows} == {BASELINE}
    assert {row["swept"] for row in rows} == {'{"particles":100}', '{"particles":300}'}
    found = list(tables_of((folder / name).read_text(encoding="utf-8")))
    for panel in panels_of(records, baseline=BASELINE):
        for table in (made(panel) for made in TABLES):
            assert [list(table.frame), *lines_of(table)] in found


# by header: the column of results.csv, and how it is written
COLUMNS = {
    "energy score, px": ("energy_score", 1.0, ".2f"),
    "entropy, nats": ("entropy", 1.0, ".2f"),
    "NEES (3)": ("nees", 1.0, ".1f"),
    "in walls": ("wall_share", 100.0, ".1f"),
}


def test_every_column_of_a_table_has_the_score_that_it_names():
    scores = {name: place / 50 for place, name in enumerate(SCORE_NAMES, 1)}
    records = [finished("mcl", world, 3.0, scores=scores) for world in range(2)]
    panel = panel_of(records)
    for table in (made(panel) for made in TABLES[1:]):
        for header, cell in table.frame.iloc[0].items():
            if header in COLUMNS:
                name, factor, form = COLUMNS[header]
                mean = cell.partition(" (")[0].removesuffix(" %")
                assert mean == f"{factor * scores[name]:{form}}", header
