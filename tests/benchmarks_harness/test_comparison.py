"""results.csv: panels, pairing, baselines, intervals and tests, on made-up records."""

import math
from dataclasses import replace

import numpy as np
import pytest
from report_cases import changed, finished, parsed, results, results_csv, table_of, trials

from benchmarks.setup.overrides import Overrides
from benchmarks.tables import stats
from benchmarks.tables.panels import baseline_of, panels
from benchmarks.trials import Method


def told(row, name):
    return tuple(row[[name, f"{name}_low", f"{name}_high"]])


def test_every_number_of_a_random_sweep_is_that_of_plain_loops():
    rng = np.random.default_rng(3)
    runs = {(name, w, s): rng.gamma(4, 5) for name in ("mcl", "x") for w in range(9)
            for s in range(3) if rng.random() < 0.8}  # fmt: skip
    records = [finished(name, w, e, filter_seed=s) for (name, w, s), e in runs.items()]
    rng.shuffle(records)
    row = table_of(records).loc["x", 0]
    worlds, apart, theirs = ([] for _ in range(3))
    for w in range(9):
        own = {s: runs["x", w, s] for s in range(3) if ("x", w, s) in runs}
        both = [s for s in own if ("mcl", w, s) in runs]
        worlds += [sum(own.values()) / len(own)] if own else []
        apart += [sum(own[s] - runs["mcl", w, s] for s in both) / len(both)] if both else []
        theirs += [sum(runs["mcl", w, s] for s in both) / len(both)] if both else []
    assert told(row, "error") == stats.estimate(np.array(worlds))
    assert told(row, "diff") == stats.estimate(np.array(apart))
    assert row.win_rate == stats.win_rate(np.array(apart))
    assert row.p == pytest.approx(stats.wilcoxon(np.array(apart)), rel=1e-5)
    assert (row.error_sd, row.diff_sd) == (np.std(worlds, ddof=1), np.std(apart, ddof=1))
    assert told(row, "relative") == stats.relative_change(np.array(apart), np.array(theirs))
    assert (row.worlds, row.paired_worlds) == (len(worlds), len(apart))


def test_the_baseline_is_not_compared_with_itself_but_its_past_is():
    rows = table_of(trials("mcl", [{0: 4.0, -20: 1.0}, {0: 5.0, -20: 2.0}]))
    assert list(rows["is_baseline"]) == [True, False]
    assert math.isnan(rows.loc["mcl", 0]["diff"])
    assert math.isnan(rows.loc["mcl", 0].p_holm)
    assert rows.loc["mcl", -20]["diff"] == -3.0


@pytest.mark.parametrize(("world", "number"), [({"noise.drive": 0.2}, 0), ({}, 1)])
def test_only_trials_of_the_same_setting_and_world_are_compared(world, number):
    records = [finished("mcl", 0, 1.0), finished("x", number, 5.0, world=world)]
    assert table_of(records)["diff"].isna().all()


def method(localizer, **params):
    return Method(localizer, Overrides(params))


VARIANTS = [method("deq-mcl", kind="a"), method("mcl", kind="a"), method("mcl", kind="b")]


@pytest.mark.parametrize(
    ("compared", "name", "expected"),
    [
        (method("deq-mcl", kind="b", lag=20), "mcl", VARIANTS[2]),
        (VARIANTS[1], "mcl", VARIANTS[1]),
        (method("dead-reckoning"), "mcl", VARIANTS[1]),  # the first
        (VARIANTS[2], "ekf", VARIANTS[0]),  # which was not run: the first method
    ],
)
def test_of_variants_the_baseline_is_the_one_with_the_shared_parameters(compared, name, expected):
    assert baseline_of(compared, [*VARIANTS, compared], name) == expected


def test_the_rate_of_lost_runs_has_the_wilson_interval_of_as_many_worlds():
    lost = {(w, s): float(w == 0 or (w == 1 and s)) for w in range(10) for s in (0, 1)}
    records = [finished("mcl", w, 1.0, filter_seed=s, scores={"lost": lost[w, s]}) for w, s in lost]
    row = table_of(records).loc["mcl", 0]
    assert row.lost_rate == pytest.approx(0.15)
    assert (row.lost_low, row.lost_high) == stats.wilson(row.lost_rate, 10)


def test_a_score_that_one_run_lacks_is_unknown_not_the_mean_of_the_rest():
    records = [finished("x", 0, 1.0), finished("x", 1, 1.0, scores={"nees": None})]
    assert math.isnan(table_of(records).loc["x", 0].nees)


def swept(worlds=3, localizer="mcl"):
    """A localizer at two values of its particles; errors 9 and 5, and something without them."""
    luck = np.arange(float(worlds))
    few, many = ({"params": {"particles": n}} for n in (100, 300))
    records = trials(localizer, 9.0 + luck, **few) + trials(localizer, 5.0 + luck, **many)
    return records + trials("ekf", 2.0 + luck)


def test_a_method_without_the_swept_parameter_is_in_each_panel_with_its_baseline():
    told = results(swept(localizer="mcl-map") + trials("grid", [1.0] * 3), baseline="mcl-map")
    for panel, n, difference in zip(told.panels, (100, 300), (-7.0, -3.0), strict=True):
        assert panel.title == f"scenario paper, particles {n}"
        assert list(panel.methods) == ["mcl-map", "ekf", "grid"]
        assert panel.methods[panel.baselines["ekf"]] == method("mcl-map", particles=n)
        rows = told.table[told.table["panel"] == panel.number].set_index("label")
        assert rows.loc["ekf", "diff"] == difference


@pytest.mark.parametrize("baseline", ["few", "mcl-map"])
def test_methods_with_labels_are_compared_in_one_panel_with_the_first_or_the_one_named(baseline):
    counts = {"few": 100, "many": 300}
    labelled = [replace(method("mcl-map", particles=n), label=k) for k, n in counts.items()]
    told = replace(results(swept(localizer="mcl-map"), baseline=baseline), labelled=labelled)
    (panel,) = told.panels
    assert list(panel.methods) == ["few", "many", "ekf"]
    rows = told.table.set_index("label")
    assert dict(rows["diff"].dropna()) == {"many": -4.0, "ekf": -7.0}


def test_what_one_method_lacks_leaves_it_in_every_panel_and_infinity_is_a_number():
    records = [finished("mcl", 0, 1.0, params={"particles": 100})]
    for beta in (0.0, math.inf):
        records += [finished("deq-mcl", 0, 1.0, params={"particles": 100, "beta": beta})]
    found = panels(records)
    assert [panel.title for panel in found] == [f"scenario paper, beta {b}" for b in (0.0, "inf")]
    assert all(list(panel.methods) == ["mcl", "deq-mcl"] for panel in found)
    assert '"{""beta"":""inf"",""particles"":100}"' in results_csv(records)


def test_settings_are_panels_named_by_what_sets_them_apart():
    noisy, assumed = {"lidar.sigma": 5.0}, {"scan.sigma": 5.0}
    named = {
        "noise.drive 0.1, L 20": {"world": {"noise.drive": 0.1}},
        "assumed scan.sigma 5.0, L 10": {"assumed": assumed, "lag": 10},
        "kidnap step 100, L 20": {"disturbance": [{"kind": "kidnap", "step": 100}]},
        "lidar.sigma 5.0, assumed scan.sigma 5.0, L 20": {"world": noisy, "assumed": assumed},
        "lidar.sigma 5.0, assumed scan.sigma 9.0, L 20": {
            "world": noisy, "assumed": {"scan.sigma": 9.0}
        },
        "lidar.sigma 5.0, noise.turn 0.1, assumed scan.sigma 5.0, L 20": {
            "world": noisy | {"noise.turn": 0.1}, "assumed": assumed
        },
    }  # fmt: skip
    records = [finished("mcl", 0, 1.0, **setting) for setting in named.values()]
    assert [one.title for one in panels(records)] == [f"scenario paper, {it}" for it in named]


def test_variants_of_a_localizer_are_side_by_side_with_names_of_their_own():
    labels, methods = ["deq-mcl", "deq-mcl moves=third", "mcl"], ["deq-mcl", "deq-mcl", "mcl"]
    runs = [*zip(methods, ({}, {"moves": "third"}, {}), strict=True)]
    sizes = [{"particles": n} for n in (300, 1000)]
    records = [finished(name, 0, 1.0, params=own | n) for n in sizes for name, own in runs]
    for panel in panels(records):
        assert list(panel.methods) == labels


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (("./a b/mine.py:Mine", "package.module:attr"), ["Mine", "attr"]),
        (("a.py:Mine", "b.py:Mine"), ["a.py:Mine", "b.py:Mine"]),
    ],
)
def test_plug_ins_are_called_by_their_class_where_that_tells_them_apart(names, labels):
    (panel,) = panels([finished(name, 0, 1.0) for name in names])
    assert list(panel.methods) == labels


def test_results_csv_has_fixed_columns_unique_lines_and_nothing_of_the_machine():
    records = swept(2)
    text = results_csv(records)
    lines = parsed(text)
    assert text.splitlines()[0] == (
        "scenario,world,assumed,disturbance,lag,seed,swept,method,params,offset,worlds,runs,"
        "error,error_low,error_high,error_sd,error_window,error_sd_steps,entropy,"
        "var_x,var_y,var_cos,var_sin,position_rmse,heading_rmse,wall_share,"
        "energy_score,coverage_50,coverage_80,coverage_95,nees,wall_step_share,outlier_share,"
        "lost_rate,lost_low,lost_high,"
        "baseline,paired_worlds,diff,diff_low,diff_high,win_rate,p,p_holm,"
        "auroc,auroc_low,auroc_high,far_steps,far_worlds,"
        "coverage_50_low,coverage_50_high,coverage_80_low,coverage_80_high,"
        "coverage_95_low,coverage_95_high,nees_low,nees_high,"
        "diff_sd,relative,relative_low,relative_high"
    )
    assert [(line["swept"], line["method"], line["diff"]) for line in lines] == [
        ('{"particles":100}', "mcl", ""),
        ('{"particles":100}', "ekf", "-7.0"),
        ('{"particles":300}', "mcl", ""),
        ('{"particles":300}', "ekf", "-3.0"),
    ]
    assert (lines[0]["params"], lines[0]["world"]) == ('{"particles":100}', "{}")
    assert text == results_csv([changed(one, seconds=99.0) for one in records])
