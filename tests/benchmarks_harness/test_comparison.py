"""results.csv: panels, pairing, baselines, intervals and tests, on made-up records."""

import math

import numpy as np
import pytest
from report_cases import changed, comparisons, finished, parsed, trials

from benchmarks.setup.changes import Changes
from benchmarks.tables import stats
from benchmarks.tables.comparison import baseline_of
from benchmarks.tables.csv_files import results_csv
from benchmarks.tables.panels import panels
from benchmarks.trials.spec import Method


def by_name(records):
    """Rows by localizer and offset, where nothing else differs."""
    return {(row.method.name, row.offset): row for row in comparisons(records)}


def test_runs_on_a_world_are_averaged_before_worlds_are():
    records = [finished("mcl", 0, 1.0), finished("mcl", 0, 3.0, filter_seed=1)]
    row = by_name([*records, finished("mcl", 1, 10.0)])["mcl", 0]
    assert (row.error.mean, row.worlds, row.runs) == (6.0, 2, 3)  # (2 + 10) / 2, not 14 / 3
    assert row.errors == {0: 2.0, 1: 10.0}


def test_the_statistics_are_those_of_the_differences():
    base = [10.0, 30.0, 50.0, 20.0, 25.0]
    own = [9.0, 31.0, 40.0, 15.0, 25.0]
    records = trials("mcl", base) + trials("x", own)
    row = by_name(records[::-1])["x", 0]  # in any order
    apart = np.array(own) - np.array(base)
    assert row.diff == (apart.mean(), *stats.paired_bootstrap(apart))
    assert row.win_rate == 3.5 / 5
    assert row.p == pytest.approx(stats.wilcoxon(apart), rel=1e-5)
    assert row.error == (np.mean(own), *stats.paired_bootstrap(np.array(own)))


def test_a_difference_is_significant_if_its_interval_excludes_0_and_the_test_confirms_it():
    base = np.zeros(20)
    apart = {
        "both": np.arange(1.0, 21),
        "interval": np.array([1.0, 2, 3, 4]),
        "test": np.append(-1.0 - np.arange(19) / 100, 40.0),  # one world outweighs nineteen
        "neither": np.arange(20) - 9.4,
    }
    records = trials("mcl", base)
    for name, errors in apart.items():
        rows = by_name(records + trials(name, errors))
        assert rows[name, 0].standing.significant == (name == "both")
    assert rows["mcl", 0].standing.significant is False


def test_the_baseline_is_not_compared_with_itself_but_its_past_is():
    rows = by_name(trials("mcl", [{0: 4.0, -20: 1.0}, {0: 5.0, -20: 2.0}]))
    assert rows["mcl", 0].is_baseline
    assert math.isnan(rows["mcl", 0].diff.mean)
    assert math.isnan(rows["mcl", 0].p_holm)
    assert rows["mcl", -20].diff.mean == -3.0


@pytest.mark.parametrize(("world", "number"), [({"noise.drive": 0.2}, 0), ({}, 1)])
def test_only_trials_of_the_same_setting_and_world_are_compared(world, number):
    records = [finished("mcl", 0, 1.0), finished("x", number, 5.0, world=world)]
    assert all(math.isnan(row.diff.mean) for row in comparisons(records))


def method(localizer, **params):
    return Method(localizer, Changes(params))


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
def test_of_several_variants_the_baseline_is_the_one_with_the_shared_parameters(
    compared, name, expected
):
    assert baseline_of(compared, [*VARIANTS, compared], name) == expected


def test_the_rate_of_lost_runs_has_the_wilson_interval_of_as_many_worlds():
    records = [
        finished("mcl", w, 1.0, filter_seed=s, scores={"lost": float(w == 0 or (w == 1 and s))})
        for w in range(10)
        for s in (0, 1)
    ]
    row = by_name(records)["mcl", 0]
    assert row.lost.mean == pytest.approx(0.15)
    assert row.lost[1:] == stats.wilson(row.lost.mean, 10)


def test_a_score_that_one_run_lacks_is_unknown_not_the_mean_of_the_rest():
    records = [finished("x", 0, 1.0), finished("x", 1, 1.0, scores={"nees": None})]
    assert math.isnan(by_name(records)["x", 0].scores["nees"].mean)


def swept(worlds=3, localizer="mcl"):
    """A localizer at two values of its particles; errors 9 and 5, and something without them."""
    luck = np.arange(float(worlds))
    few, many = ({"params": {"particles": n}} for n in (100, 300))
    records = trials(localizer, 9.0 + luck, **few) + trials(localizer, 5.0 + luck, **many)
    return records + trials("ekf", 2.0 + luck)


def test_a_method_without_the_swept_parameter_is_in_each_panel_with_its_baseline():
    found = panels(swept(localizer="mcl-map") + trials("grid", [1.0] * 3), "mcl-map")
    for panel, n, difference in zip(found, (100, 300), (-7.0, -3.0), strict=True):
        assert panel.title == f"scenario paper, particles {n}"
        assert list(panel.labels.values()) == ["mcl-map", "ekf", "grid"]
        assert panel.present[1].baseline == method("mcl-map", particles=n)
        assert panel.present[1].diff.mean == difference


def test_what_one_method_lacks_leaves_it_in_every_panel_and_infinity_is_a_number():
    records = [finished("mcl", 0, 1.0, params={"particles": 100})]
    for beta in (0.0, math.inf):
        records += [finished("deq-mcl", 0, 1.0, params={"particles": 100, "beta": beta})]
    found = panels(records)
    assert [panel.title for panel in found] == [f"scenario paper, beta {b}" for b in (0.0, "inf")]
    assert all(list(panel.labels.values()) == ["mcl", "deq-mcl"] for panel in found)
    assert '"{""beta"":""inf"",""particles"":100}"' in results_csv(found)


def test_settings_are_panels_named_by_what_sets_them_apart():
    noisy, assumed = {"lidar.sigma": 5.0}, {"scan.sigma": 5.0}
    named = {
        "noise.drive 0.1, L 20": {"world": {"noise.drive": 0.1}},
        "assumed scan.sigma 5.0, L 10": {"assumed": assumed, "lag": 10},
        "kidnap step 100, L 20": {"disturbance": [{"kind": "kidnap", "step": 100}]},
        "lidar.sigma 5.0, filters assume the same, L 20": {"world": noisy, "assumed": assumed},
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
    variants = [
        ("deq-mcl-rejuvenated", {}),
        ("deq-mcl-rejuvenated", {"moves": "third"}),
        ("mcl", {}),
    ]
    records = [
        finished(name, 0, 1.0, params=params | {"particles": n})
        for n in (300, 1000)
        for name, params in variants
    ]
    for panel in panels(records):
        assert list(panel.labels.values()) == [
            "deq-mcl-rejuvenated",
            "deq-mcl-rejuvenated moves=third",
            "mcl",
        ]


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (("./a b/mine.py:Mine", "package.module:attr"), ["Mine", "attr"]),
        (("a.py:Mine", "b.py:Mine"), ["a.py:Mine", "b.py:Mine"]),
    ],
)
def test_plug_ins_are_called_by_their_class_where_that_tells_them_apart(names, labels):
    (panel,) = panels([finished(name, 0, 1.0) for name in names])
    assert list(panel.labels.values()) == labels


def test_results_csv_has_fixed_columns_unique_lines_and_nothing_of_the_machine():
    records = swept(2)
    text = results_csv(panels(records))
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
    assert text == results_csv(panels([changed(one, seconds=99.0) for one in records]))


def test_settings_and_methods_are_equal_in_any_order_of_their_parts():
    one = finished("x", 0, 1.0, params={"a": 1, "b": [1, 2]}, world={"p": 1, "q": 2})
    other = finished("x", 0, 1.0, params={"b": [1, 2], "a": 1}, world={"q": 2, "p": 1})
    assert one.trial.setting == other.trial.setting
    assert {one.trial.method: "found"}[other.trial.method] == "found"
    assert '"{""a"":1,""b"":[1,2]}"' in results_csv(panels([one]))
