"""table.csv, trials.csv, timings.csv on made-up records."""

import math

import numpy as np
import pytest
from fake_records import parsed, record

from benchmarks.tables.stats import paired_bootstrap
from benchmarks.tables.table_1 import table_csv, table_rows, timings_csv, trials_csv

HEADER = (  # of the issue
    "method,offset,error,error_sd,error_window,entropy,var_x,var_y,var_cos,var_sin,"
    "position_rmse,heading_rmse,wall_share,diff_vs_mcl,diff_low,diff_high,trials"
)
DIFF = ("diff_vs_mcl", "diff_low", "diff_high")


def table(*records):
    """Lines of table.csv by (method, offset)."""
    lines = parsed(table_csv(table_rows(records)))
    return {(line["method"], int(line["offset"])): line for line in lines}


def test_the_columns_are_exactly_those_promised():
    text = table_csv(table_rows([record("mcl", 0, {0: 1.0})]))
    assert text.splitlines()[0] == HEADER
    assert text.endswith("\n")
    assert "\r" not in text


def test_there_is_one_row_per_method_and_offset_in_the_order_given():
    records = [record("b", 0, {0: 1.0, -20: 1.0}), record("a", 0, {0: 1.0, -20: 1.0, 20: 1.0})]
    rows = [(row.method, row.offset) for row in table_rows(records)]
    assert rows == [("b", 0), ("b", -20), ("a", 0), ("a", -20), ("a", 20)]


@pytest.mark.parametrize(
    "column",
    [
        *("error_window", "entropy", "var_x", "var_y", "var_cos", "var_sin"),
        *("position_rmse", "heading_rmse", "wall_share"),
    ],
)
def test_each_score_is_the_mean_over_trials_of_that_score(column):
    values = [1.5, 2.5, 8.0]
    made = [record("mcl", i, {0: 1.0}, **{column: value}) for i, value in enumerate(values)]
    row = table(*made)["mcl", 0]
    assert float(row[column]) == 4.0
    assert row["trials"] == "3"


def test_the_error_is_a_mean_over_trials_and_its_sd_has_one_degree_of_freedom_less():
    row = table(*(record("mcl", i, {0: e}) for i, e in enumerate([1.0, 2.0, 6.0])))["mcl", 0]
    assert float(row["error"]) == 3.0
    assert float(row["error_sd"]) == pytest.approx(math.sqrt((4 + 1 + 9) / 2), rel=1e-15)


def test_the_difference_to_mcl_is_paired_world_by_world_with_mcls_present():
    baseline, errors = [10.0, 30.0, 50.0], [9.0, 25.0, 47.0]  # -1, -5, -3
    records = [record("mcl", i, {0: e, -20: 1000.0}) for i, e in enumerate(baseline)]
    records += [record("deq-mcl", i, {0: e, -20: e + 2}) for i, e in enumerate(errors)]
    rows = table(*records[::-1])  # in any order
    assert float(rows["deq-mcl", 0]["diff_vs_mcl"]) == -3.0
    assert float(rows["deq-mcl", -20]["diff_vs_mcl"]) == -1.0  # not to mcl's error at -20
    assert [float(rows["mcl", 0][name]) for name in DIFF] == [0.0, 0.0, 0.0]
    # three worlds: every resample of (-5, -3, -1) is as likely as any; all three the same worst
    # world has probability 1/27 > 2.5 %, so the interval ends at the extremes
    assert [float(rows["deq-mcl", 0][name]) for name in DIFF[1:]] == [-5.0, -1.0]


def test_the_interval_is_the_paired_bootstrap_of_the_differences():
    baseline, errors = [10.0, 30.0, 50.0, 20.0], [9.0, 31.0, 40.0, 22.0]
    records = [record("mcl", i, {0: e}) for i, e in enumerate(baseline)]
    (row,) = table_rows([record("x", i, {0: e}) for i, e in enumerate(errors)] + records)[:1]
    differences = [e - b for e, b in zip(errors, baseline, strict=True)]
    assert (row.diff_low, row.diff_high) == paired_bootstrap(np.array(differences))


def test_without_mcl_there_is_no_difference():
    row = table(*(record("deq-mcl", i, {0: float(i)}) for i in range(3)))["deq-mcl", 0]
    assert [row[name] for name in DIFF] == ["", "", ""]


def test_only_worlds_that_both_have_run_are_compared():
    records = [record("mcl", i, {0: 10.0 * i}) for i in (1, 2, 3)]
    records += [record("x", i, {0: 10.0 * i + i}) for i in (0, 1, 2)]  # shared: 1 and 2
    row = table(*records)["x", 0]
    assert float(row["diff_vs_mcl"]) == 1.5
    assert row["trials"] == "3"  # the mean error is over all it ran
    assert float(row["error"]) == 11.0


def test_worlds_none_of_which_are_shared_are_not_compared():
    records = [record("mcl", 0, {0: 1.0}), record("x", 1, {0: 2.0})]
    assert [table(*records)["x", 0][name] for name in DIFF] == ["", "", ""]


def test_runs_of_a_world_with_other_filter_seeds_are_paired_by_their_filter_seed():
    records = [record("mcl", 0, {0: 10.0 * j}, filter_seed=j) for j in range(2)]
    records += [record("x", 0, {0: 10.0 * j + 3}, filter_seed=j) for j in range(2)]
    row = table(*records)["x", 0]
    assert [float(row[name]) for name in DIFF] == [3.0, 3.0, 3.0]


def test_one_trial_has_a_difference_but_neither_sd_nor_interval():
    row = table(record("mcl", 0, {0: 10.0}), record("x", 0, {0: 8.0}))["x", 0]
    assert row["diff_vs_mcl"] == "-2.0"
    assert [row[name] for name in ("error_sd", *DIFF[1:])] == ["", "", ""]


@pytest.mark.parametrize("unknown", [None, math.nan])
def test_what_is_not_available_is_an_empty_cell_never_zero(unknown):
    row = table(record("dead-reckoning", 0, {0: 1.0}, entropy=unknown, var_x=unknown))
    cells = row["dead-reckoning", 0]
    assert cells["entropy"] == cells["var_x"] == ""
    assert cells["var_y"] == "1.0"


def test_a_trial_without_a_score_makes_the_mean_unknown_rather_than_that_of_the_rest():
    records = [record("x", 0, {0: 1.0}), record("x", 1, {0: 1.0}, entropy=None)]
    assert table(*records)["x", 0]["entropy"] == ""


def test_numbers_are_written_so_that_they_are_read_back_exactly():
    value = 0.1 + 0.2
    assert float(table(record("mcl", 0, {0: value}))["mcl", 0]["error"]) == value


def test_trials_csv_has_a_line_per_trial_and_offset_with_its_counts():
    text = trials_csv(
        [
            record("mcl", 4, {0: 7.5}, entropy=None) | {"events": {"replanned_steps": 3}},
            record("deq-mcl", 4, {0: 1.0, -20: 2.0}, filter_seed=1),
        ]
    )
    first, *rest = parsed(text)
    expected = {"method": "mcl", "trial": "4", "filter_seed": "0", "offset": "0", "error": "7.5"}
    assert {name: first[name] for name in expected} == expected
    assert (first["entropy"], first["steps_done"], first["scans_used"]) == ("", "200", "199")
    assert (first["replanned_steps"], first["weight_collapses"]) == ("3", "")
    assert [(line["offset"], line["error"], line["filter_seed"]) for line in rest] == [
        ("0", "1.0", "1"),
        ("-20", "2.0", "1"),
    ]


def test_timings_csv_has_a_line_per_trial_in_seconds_and_milliseconds_per_step():
    timed, untimed = record("mcl", 0, {0: 1.0}), record("mcl", 1, {0: 1.0}) | {"seconds": None}
    lines = parsed(timings_csv([timed, untimed]))
    assert [(line["seconds"], line["ms_per_step"]) for line in lines] == [("0.5", "2.5"), ("", "")]
