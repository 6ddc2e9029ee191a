"""The readable Table 1: the paper's values beside ours, and the sentence on dead reckoning."""

import pytest
from report_cases import finished, paired

from benchmarks.tables.panels import comparisons
from benchmarks.tables.table_1 import TITLES, reading, table_1

PRINTED = {  # typed from Table 1 of the paper: error, SD, entropy, variances of x, y, cos θ, sin θ
    "deq-mcl": ("20.95 (17.66)", "7.82", "419.92", "290.04", "0.09", "0.07"),
    "mcl-smoother": ("22.88 (20.01)", "8.88", "977.39", "611.06", "0.14", "0.11"),
    "mcl-map": ("25.00 (18.38)", "9.69", "792.28", "616.85", "0.17", "0.16"),
    "mcl": ("26.17 (22.00)", "9.81", "966.93", "591.79", "0.19", "0.16"),
}
UNPRINTED = ("mcl-map-smoother", "dead-reckoning", "somebodys-plug-in")
PAPER = (4, 6, 9, 11, 13, 15)  # columns


def lines(*records):
    """Cells of each line below the header of the Markdown table."""
    text = table_1(comparisons(records), "github")
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()[2:]]


@pytest.mark.parametrize("offset", [0, -20])
@pytest.mark.parametrize("method", PRINTED)
def test_the_papers_printed_values_stand_beside_ours(method, offset):
    *_, cells = lines(finished(method, 0, {0: 1.0, offset: 123.456}))
    assert tuple(cells[i] for i in PAPER) == PRINTED[method]
    assert cells[3] == "123.46 (n/a)"


@pytest.mark.parametrize(
    ("method", "offset"), [*((method, 20) for method in PRINTED), *((m, 0) for m in UNPRINTED)]
)
def test_what_the_paper_did_not_print_stays_empty(method, offset):
    *_, cells = lines(finished(method, 0, {0: 1.0, offset: 1.0}))
    assert [cells[i] for i in PAPER] == [""] * 6


def test_our_values_are_rounded_and_named():
    scores = {"entropy": 9.876, "var_x": 1000.04, "var_cos": 0.1234, "wall_share": 0.0456}
    made = [finished("mcl", i, e, scores=scores) for i, e in enumerate([1.0, 2.0, 6.0])]
    made += [finished("mcl-map", i, {0: e, -20: e}) for i, e in enumerate([2.0, 3.0, 7.0])]
    mcl, _, past = lines(*made)
    assert mcl[:4] == ["MCL", "x[t]", "baseline", "3.00 (2.65)"]
    assert (mcl[5], mcl[7], mcl[8], mcl[12]) == ("9.88", "4.6 %", "1000.0", "0.123")
    title = "MCL with map-based motion model"
    assert past[:3] == [title, "x[t-20]", "+1.00 [+1.00, +1.00]"]


def test_what_is_unknown_reads_na_and_a_difference_without_interval_stands_alone():
    unknown = {"entropy": None, "wall_share": None}
    _, now, past = lines(
        finished("mcl", 0, 5.0), finished("x", 0, {0: 3.5, -204: None}, scores=unknown)
    )
    assert (now[2], now[5], now[7]) == ("-1.50", "n/a", "n/a")
    assert (past[2], past[3]) == ("n/a", "n/a (n/a)")


def test_in_a_terminal_no_line_of_any_method_of_ours_is_longer_than_120_columns():
    rows = comparisons(paired(dict.fromkeys(("mcl", *TITLES), (1234.5, (0, -20, 20)))))
    for line in table_1(rows, "simple").splitlines():
        assert len(line) <= 120
    header = table_1(rows, "simple").splitlines()[0]
    assert header.split()[:5] == ["method", "of", "error", "-", "mcl's,"]


def sentence(**errors):
    """The reading of a table with these errors at x[t]; underscores for hyphens."""
    records = [finished(name.replace("_", "-"), 0, {0: e, -20: 0.5}) for name, e in errors.items()]
    return reading(comparisons(records))


def test_it_is_said_when_dead_reckoning_wins_and_what_that_means():
    said = sentence(mcl=9.0, deq_mcl=7.0, dead_reckoning=3.25)
    assert "has a smaller error at x[t] than every filter (3.25;" in said
    assert "DEQ-MCL: 7.00" in said
    assert "not whether localization is needed" in said


def test_it_is_said_when_dead_reckoning_loses():
    said = sentence(mcl=6.0, deq_mcl=7.0, dead_reckoning=8.0)
    assert said.endswith("(error 8.00 at x[t]) is worse than the best filter (MCL: 6.00).")


@pytest.mark.parametrize("run", [{"mcl": 6.0}, {"dead_reckoning": 3.0}, {}])
def test_nothing_is_said_without_dead_reckoning_or_without_a_filter(run):
    assert sentence(**run) == ""
