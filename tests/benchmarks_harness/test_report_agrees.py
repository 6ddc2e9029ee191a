"""The page, the Markdown and results.csv tell the same numbers."""

import math
import re
from html import unescape

import pytest
from report_cases import finished, paired, parsed, results, written

from benchmarks.report import error_tables, tables
from benchmarks.tables.panels import panels
from benchmarks.trials.scoring import SCORE_NAMES

BASELINE = "mcl-map"  # neither the usual one nor the first


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    records = paired({"ekf": (18.5, (0,)), "grid": (10.0, (0,))})  # have no particles
    for n, shift in ((300, 0.0), (100, 3.0)):
        methods = {"mcl": (20.0 + shift, (0,)), BASELINE: (17.0 + shift, (0, -20))}
        records = paired(methods, params={"particles": n}) + records
    out = tmp_path_factory.mktemp("agree")
    written(out, results(records, baseline=BASELINE))
    return out


def of_html(text):
    """The cells of each table, line by line."""
    for table in re.findall("<table>.*?</table>", text, re.DOTALL):
        lines = re.findall("<tr[^>]*>(.*?)</tr>", unescape(table).replace("\u00a0", " "), re.DOTALL)
        yield [re.findall("<t[hd][^>]*>(.*?)</t[hd]>", one) for one in lines]


def of_markdown(text):
    """The same of the Markdown."""
    for block in text.split("\n\n"):
        if block.startswith("|"):
            cells = block.replace("**", "").splitlines()
            lines = [[c.strip() for c in one.strip("|").split("|")] for one in cells]
            yield [lines[0], *lines[2:]]


def told(row, name, form):
    return f"{float(row[name]):{form}}".replace("-", "−")


def ranged(row, name, form):
    mean, *ends = (told(row, f"{name}{end}", form) for end in ("", "_low", "_high"))
    return f"{mean} ({ends[0]} to {ends[1]})"


def verdict(row):
    """Method, error, difference, corrected p, as the tables have them."""
    error = f"{told(row, 'error', '.2f')} ({told(row, 'error_sd', '.2f')})"
    if not row["diff"]:
        return [f"{row['method']} (baseline)", error, "baseline", "–"]
    difference = ranged(row, "diff", ".2f")
    sign = "" if difference.startswith("−") else "+"
    return [row["method"], error, sign + difference, f"{float(row['p_holm']):.2g}"]


@pytest.mark.parametrize(
    ("name", "tables_of"), [("report.html", of_html), ("results.md", of_markdown)]
)
def test_every_number_of_the_comparison_is_that_of_results_csv(folder, name, tables_of):
    rows = parsed((folder / "results.csv").read_text())
    assert {row["baseline"] for row in rows} == {BASELINE}
    assert {row["swept"] for row in rows} == {'{"particles":100}', '{"particles":300}'}
    found = list(tables_of((folder / name).read_text(encoding="utf-8")))

    def lines(column):
        return [line for table in found if column in table[0] for line in table[1:]]

    verdicts = [[line[i] for i in (0, 1, 2, 4)] for line in lines("wins")]
    present = [row for row in rows if row["offset"] == "0"]
    swept = list(dict.fromkeys(row["swept"] for row in rows))
    by_error = sorted(present, key=lambda row: (swept.index(row["swept"]), float(row["error"])))
    assert verdicts == list(map(verdict, by_error))
    assert [line[6] for line in lines("NEES (3)")] == [ranged(row, "nees", ".1f") for row in rows]
    assert [line[6] for line in lines("error, common states")] == [verdict(row)[2] for row in rows]


# by header: the column of results.csv, and how it is written
COLUMNS = {
    "error, common states": ("error_window", 1.0, ".2f"),
    "position RMSE, px": ("position_rmse", 1.0, ".2f"),
    "heading RMSE, °": ("heading_rmse", 180 / math.pi, ".1f"),
    "energy score, px": ("energy_score", 1.0, ".2f"),
    "entropy, nats": ("entropy", 1.0, ".2f"),
    "in walls": ("wall_share", 100.0, ".1f"),
}


def test_every_column_of_a_table_has_the_score_that_it_names():
    scores = {name: place / 50 for place, name in enumerate(SCORE_NAMES, 1)}
    records = [finished("mcl", world, 3.0, scores=scores) for world in range(2)]
    (panel,) = panels(records)
    for table in (error_tables.offsets_table(panel), tables.calibration_table(panel)):
        for header, cell in zip(table.header, table.lines[0], strict=True):
            if header in COLUMNS:
                name, factor, form = COLUMNS[header]
                assert cell.removesuffix(" %") == f"{factor * scores[name]:{form}}", header
