"""The readable Table 1: the paper's values beside ours, and the sentence on dead reckoning."""

import pytest
from fake_records import record

from benchmarks.tables.table_1 import reading, table_1, table_rows

PRINTED = {  # typed from Table 1 of the paper: error, SD, entropy, variances of x, y, cos θ, sin θ
    "deq-mcl": ("20.95 (17.66)", "7.82", "419.92", "290.04", "0.09", "0.07"),
    "mcl-smoother": ("22.88 (20.01)", "8.88", "977.39", "611.06", "0.14", "0.11"),
    "mcl-map": ("25.00 (18.38)", "9.69", "792.28", "616.85", "0.17", "0.16"),
    "mcl": ("26.17 (22.00)", "9.81", "966.93", "591.79", "0.19", "0.16"),
}
UNPRINTED = ("mcl-map-smoother", "dead-reckoning", "somebodys-plug-in")


def lines(*records):
    """Cells of each line below the header of the Markdown table."""
    text = table_1(table_rows(records), "github")
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()[2:]]


@pytest.mark.parametrize("offset", [0, -20])
@pytest.mark.parametrize("method", PRINTED)
def test_the_papers_printed_values_stand_beside_ours(method, offset):
    (cells,) = lines(record(method, 0, {offset: 123.456}))
    assert tuple(cells[i] for i in (3, 5, 7, 9, 11, 13)) == PRINTED[method]
    assert cells[2] == "123.46 (n/a)"


@pytest.mark.parametrize(
    ("method", "offset"), [*((method, 20) for method in PRINTED), *((m, 0) for m in UNPRINTED)]
)
def test_what_the_paper_did_not_print_stays_empty(method, offset):
    (cells,) = lines(record(method, 0, {offset: 1.0}))
    assert [cells[i] for i in (3, 5, 7, 9, 11, 13)] == [""] * 6


def test_our_values_are_rounded_and_named():
    made = [
        record(
            "mcl", i, {0: error}, entropy=9.876, var_x=1000.04, var_cos=0.1234, wall_share=0.0456
        )
        for i, error in enumerate([1.0, 2.0, 6.0])
    ]
    (cells,) = lines(*made)
    assert cells[:3] == ["MCL", "x[t]", "3.00 (2.65)"]
    assert (cells[4], cells[6], cells[10]) == ("9.88", "1000.0", "0.123")
    assert cells[-2:] == ["+0.00 [+0.00, +0.00]", "4.6 %"]


def test_offsets_are_named_as_states():
    made = lines(record("deq-mcl", 0, {0: 1.0, -20: 1.0, 20: 1.0}))
    assert [cells[1] for cells in made] == ["x[t]", "x[t-20]", "x[t+20]"]


def test_what_is_unknown_reads_na_and_a_difference_without_interval_stands_alone():
    made = lines(
        record("mcl", 0, {0: 5.0}), record("x", 0, {0: 3.5}, entropy=None, wall_share=None)
    )
    assert (made[1][4], made[1][-1]) == ("n/a", "n/a")
    assert made[1][-2] == "-1.50"
    assert lines(record("x", 0, {0: 3.5}))[0][-2] == "n/a"


def test_an_error_that_is_unknown_has_no_difference_to_mcls():
    made = lines(record("mcl", 0, {0: 5.0}), record("deq-mcl", 0, {0: 3.5, -204: None}))
    assert [cells[-2] for cells in made] == ["+0.00", "-1.50", "n/a"]
    assert made[2][2] == "n/a (n/a)"


def sentence(**errors):
    """The reading of a table with these errors at x[t]; underscores for hyphens."""
    return reading(
        table_rows(
            [record(name.replace("_", "-"), 0, {0: e, -20: 0.5}) for name, e in errors.items()]
        )
    )


def test_it_is_said_when_dead_reckoning_wins_and_what_that_means():
    said = sentence(mcl=9.0, deq_mcl=7.0, dead_reckoning=3.25)
    assert said.startswith("Dead reckoning on the plan (error 3.25) beats the best filter")
    assert "DEQ-MCL: 7.00" in said
    assert "not whether localization is needed" in said


def test_it_is_said_when_dead_reckoning_loses():
    said = sentence(mcl=6.0, deq_mcl=7.0, dead_reckoning=8.0)
    assert "is beaten by the best filter at x[t] (MCL: 6.00)" in said
    assert "beats" not in said


def test_a_reading_is_one_sentence_on_one_line():
    for blind in (1.0, 100.0):
        said = sentence(mcl=6.0, dead_reckoning=blind)
        assert said.endswith(".")
        assert ". " not in said
        assert "\n" not in said


@pytest.mark.parametrize("run", [{"mcl": 6.0}, {"dead_reckoning": 3.0}, {}])
def test_nothing_is_said_without_dead_reckoning_or_without_a_filter(run):
    assert sentence(**run) == ""
