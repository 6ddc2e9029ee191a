"""results.csv: pairing, baselines, intervals and tests, on made-up records."""

import csv
import io
import math

import numpy as np
import pytest
from fake_records import record

from benchmarks.tables import stats
from benchmarks.tables.comparison import baseline_of, comparisons, results_csv
from benchmarks.tables.pairing import Method, method_of, setting_of


def run(method, trial, errors, *, filter_seed=0, params=None, scores=None, **setting):
    made = record(method, trial, errors, filter_seed=filter_seed, **(scores or {}))
    made["trial"] |= {
        "scenario": "paper",
        "world": {},
        "assumed": {},
        "disturbance": [],
        "lag": 20,
        "seed": 0,
        "params": params or {},
    } | setting
    return made


def rows_of(*records):
    return {(row.setting, row.method, row.offset): row for row in comparisons(records)}


def by_name(*records):
    """Rows by localizer and offset, where nothing else differs."""
    return {(row.method.localizer, row.offset): row for row in comparisons(records)}


def test_runs_on_a_world_are_averaged_before_worlds_are():
    records = [run("mcl", 0, {0: 1.0}), run("mcl", 0, {0: 3.0}, filter_seed=1)]
    records += [run("mcl", 1, {0: 10.0})]
    row = by_name(*records)["mcl", 0]
    assert (row.error, row.worlds, row.runs) == (6.0, 2, 3)  # (2 + 10) / 2, not 14 / 3
    assert row.error_sd == pytest.approx(math.sqrt(32))


def test_a_difference_is_paired_by_world_and_filter_seed():
    records = [run("mcl", w, {0: 10.0 * w + s}, filter_seed=s) for w in (0, 1) for s in (0, 1)]
    # it lacks a run in each world, and 10 more is not its merit
    records += [run("x", 0, {0: 5.0}, filter_seed=0), run("x", 1, {0: 14.0}, filter_seed=1)]
    row = by_name(*records)["x", 0]
    assert (row.diff, row.paired_worlds) == (4.0, 2)  # (5 - 0 + 14 - 11) / 2


def test_the_statistics_are_those_of_the_differences():
    base = [10.0, 30.0, 50.0, 20.0, 25.0]
    own = [9.0, 31.0, 40.0, 15.0, 25.0]
    records = [run("mcl", i, {0: e}) for i, e in enumerate(base)]
    records += [run("x", i, {0: e}) for i, e in enumerate(own)]
    row = by_name(*records)["x", 0]
    differences = np.array(own) - np.array(base)
    assert (row.diff_low, row.diff_high) == stats.paired_bootstrap(differences)
    assert row.win_rate == 3.5 / 5
    assert row.p == pytest.approx(stats.wilcoxon(differences), rel=1e-5)
    assert (row.error_low, row.error_high) == stats.paired_bootstrap(np.array(own))


def test_the_baseline_is_not_compared_with_itself_but_its_past_is():
    rows = by_name(*(run("mcl", i, {0: 4.0 + i, -20: 1.0 + i}) for i in range(3)))
    assert math.isnan(rows["mcl", 0].diff)
    assert math.isnan(rows["mcl", 0].p_holm)
    assert rows["mcl", -20].diff == -3.0


def test_holms_family_is_the_tests_of_one_setting_at_one_offset():
    records = [run("mcl", i, {0: 10.0 + i, -20: 5.0}) for i in range(8)]
    for name, shift in (("a", 1.0), ("b", -1.0)):
        records += [run(name, i, {0: 10.0 + i + shift * (i + 1)}) for i in range(8)]
    records += [run("a", i, {0: 0.1 * i}, scenario="sharp") for i in range(8)]
    rows = by_name(*[r for r in records if r["trial"]["scenario"] == "paper"])
    single = 2 / 2**8
    assert rows["a", 0].p == pytest.approx(single, rel=1e-5)
    assert rows["a", 0].p_holm == rows["b", 0].p_holm == pytest.approx(2 * single, rel=1e-5)
    assert rows["mcl", -20].p_holm == rows["mcl", -20].p
    both = rows_of(*records)
    assert {row.p_holm for key, row in both.items() if key[1].localizer == "b"} == {2 * single}


def test_only_trials_of_the_same_setting_are_compared():
    records = [run("mcl", 0, {0: 1.0}, world={"noise.drive": 0.1})]
    records += [run("x", 0, {0: 5.0}, world={"noise.drive": 0.2})]
    assert all(math.isnan(row.diff) for row in comparisons(records))


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        (Method("deq-mcl", '{"lag":20,"particles":300}'), Method("mcl", '{"particles":300}')),
        (Method("mcl", '{"particles":100}'), Method("mcl", '{"particles":100}')),
        (Method("dead-reckoning", "{}"), Method("mcl", '{"particles":100}')),  # the first
    ],
)
def test_the_baseline_is_mcl_with_the_shared_parameters(method, expected):
    methods = [Method("deq-mcl", '{"particles":100}'), Method("mcl", '{"particles":100}')]
    methods += [Method("mcl", '{"particles":300}'), method]
    assert baseline_of(method, methods) == expected


def test_without_mcl_the_baseline_is_the_first_method():
    methods = [Method("x", "{}"), Method("y", "{}")]
    assert baseline_of(methods[1], methods) == methods[0]


def test_the_rate_of_lost_runs_has_the_wilson_interval_of_as_many_worlds():
    records = [
        run("mcl", w, {0: 1.0}, filter_seed=s, scores={"lost": float(w == 0 or (w == 1 and s))})
        for w in range(10)
        for s in (0, 1)
    ]
    row = by_name(*records)["mcl", 0]
    assert row.lost_rate == pytest.approx(0.15)
    assert (row.lost_low, row.lost_high) == stats.wilson(row.lost_rate, 10)


def test_a_score_that_one_run_lacks_is_unknown():
    records = [run("x", i, {0: 1.0}, scores={"nees": None if i else 2.0}) for i in (0, 1)]
    assert math.isnan(by_name(*records)["x", 0].means["nees"])


def test_results_csv_has_fixed_columns_and_nothing_of_the_machine():
    records = [run("mcl", i, {0: 1.0 + i}, params={"particles": 10}) for i in range(2)]
    text = results_csv(comparisons(records))
    (line,) = csv.DictReader(io.StringIO(text))
    assert text.splitlines()[0] == (
        "scenario,world,assumed,disturbance,lag,seed,method,params,offset,worlds,runs,"
        "error,error_low,error_high,error_sd,error_window,error_sd_steps,entropy,"
        "var_x,var_y,var_cos,var_sin,position_rmse,heading_rmse,wall_share,"
        "energy_score,coverage_50,coverage_80,coverage_95,nees,lost_rate,lost_low,lost_high,"
        "baseline,paired_worlds,diff,diff_low,diff_high,win_rate,p,p_holm,"
        "auroc,auroc_low,auroc_high,far_steps,far_worlds"
    )
    assert (line["params"], line["world"], line["error"]) == ('{"particles":10}', "{}", "1.5")
    assert line["diff"] == ""
    slower = [one | {"seconds": 99.0} for one in records]
    assert results_csv(comparisons(slower)) == text


def test_settings_and_methods_know_nested_values_in_any_order():
    one = run("x", 0, {0: 1.0}, params={"a": 1, "b": [1, 2]}, world={"p": 1, "q": 2})["trial"]
    other = one | {"params": {"b": [1, 2], "a": 1}, "world": {"q": 2, "p": 1}}
    assert setting_of(one) == setting_of(other)
    assert method_of(one) == method_of(other)
