"""Scores of whole runs over worlds: censored curves, paired tests, CSV files, the report."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import report_cases
from report_cases import changed, finished, lines_of, panel_of, parsed, results_csv, table_of, whole
from test_store import TRIAL, record_of

from benchmarks.report.charts import journey_charts
from benchmarks.report.films import films_of
from benchmarks.report.runs import starts_table
from benchmarks.report.tables import glance_table, journey_table, verdict_table
from benchmarks.report.verdict import verdict_on
from benchmarks.sweeps.store import writing
from benchmarks.tables.frames import share_curve
from benchmarks.tables.stats import median_estimate, sign_test, wilson
from benchmarks.trials.scores import GROUPS
from benchmarks.trials.scoring import WholeRun

NEVER = math.inf
WORLDS = 12
COLUMNS = ["runs", "localized", "metres_median", "steps_median"]


def test_the_curve_of_a_hand_made_case_counts_censored_runs_as_not_localized():
    # two runs on world 2: its half counts as half a world
    worlds = pd.Index([0, 1, 2, 2, 3], name="trial")
    curve = share_curve(pd.Series([1.0, 3.0, 2.0, NEVER, NEVER], worlds))
    assert list(curve["metres"]) == [0, 1, 2, 3]
    assert list(curve["share"]) == [0, 1 / 4, 1.5 / 4, 2.5 / 4]
    assert tuple(curve[["low", "high"]].iloc[-1]) == wilson(2.5 / 4, 4)


@pytest.mark.parametrize(
    ("metres", "middle"), [([1.0, NEVER, 2.0], 2), ([1.0, 2.0], 1.5), ([1.0, NEVER], NEVER)]
)
def test_the_median_of_censored_metres_is_infinite_if_half_of_them_are(metres, middle):
    assert median_estimate(np.array(metres)).mean == middle


def test_the_interval_of_a_median_is_between_the_40th_and_61st_of_a_hundred():
    # the table of Conover 1999: P(Binomial(100, ½) < 40) = 0.0176, < 41 0.0284
    assert median_estimate(np.arange(1.0, 101)) == (50.5, 40, 61)
    assert median_estimate(np.array([1.0] * 5 + [NEVER])) == (1, 1, NEVER)
    assert math.isnan(median_estimate(np.ones(5)).low)  # 2/2⁵ > 5 %


@pytest.mark.parametrize(
    ("better", "worse", "p"),
    [(5, 1, 14 / 64), (6, 0, 2 / 64), (3, 3, 1.0), (0, 0, 1.0)],  # twice a binomial tail
)
def test_the_sign_test_counts_discordant_pairs_as_mc_nemar_does(better, worse, p):
    apart = np.array([1.0] * better + [-1.0] * worse + [0.0] * 7)
    assert sign_test(apart) == pytest.approx(p)
    assert sign_test(-apart) == sign_test(apart)


def run(method, world, metres, *, way=10.0, success=None, filter_seed=0, **scores):
    found = math.isfinite(metres)
    record = finished(method, world, 1.0 + world, filter_seed=filter_seed)
    scores |= {"success_1m": float(found if success is None else success)}
    return whole(record, scores | {"metres_to_localize": metres if found else None}, way)


BLIND = [run("mcl-map", world, metres) for world, metres in enumerate([4.0, NEVER, 8.0, NEVER])]
AWARE = [run("mcl-plan", world, metres) for world, metres in enumerate([2.0, 3.0, 8.0])]
FAILURES = {"baseline": "mcl-map", "failures": [(report_cases.trial_of("mcl-plan", 3), "boom")]}
ROWS = [*BLIND, *AWARE]


def test_metres_are_compared_by_restricted_means_and_a_failed_run_is_not_localized():
    rows = table_of(ROWS, **FAILURES)
    assert list(rows["metres_to_localize"]) == [NEVER, 5.5]  # two of four never do
    blind, aware = (4 + 10 + 8 + 10) / 4, (2 + 3 + 8 + 10) / 4
    assert list(rows["metres_to_localize_restricted"]) == [blind, aware]
    first, second = rows["metres_to_localize_diff"]
    assert second == (-2 - 7 + 0 + 0) / 4
    assert math.isnan(first)


def test_shares_are_of_all_runs_the_failed_ones_too():
    rows = table_of(ROWS, **FAILURES)
    aware = rows.loc["mcl-plan", 0]
    assert list(rows["success_1m"]) == [0.5, 0.75]
    assert (aware.success_1m_low, aware.success_1m_high) == wilson(0.75, 4)
    assert (aware.success_1m_diff, aware.success_1m_p) == (0.25, 1.0)  # one discordant pair


def test_a_run_that_ends_early_is_not_the_better_for_it():
    # it breaks off after 1 m: its metres count as the 10 that the other drove
    broken = run("mcl-plan", 0, NEVER, way=1.0)
    rows = table_of([run("mcl-map", 0, NEVER, way=10.0), broken], baseline="mcl-map")
    assert rows.loc["mcl-plan", 0].metres_to_localize_restricted == 10


def test_all_tests_of_a_panel_are_one_family_of_holm():
    worlds = range(12)
    blind = [run("mcl-map", world, 9.0) for world in worlds]
    aware = [run("mcl-plan", world, 1.0 + 0.1 * world) for world in worlds]
    row = table_of([*blind, *aware], baseline="mcl-map").loc["mcl-plan", 0]
    assert (row.p, row.success_1m_p) == (1.0, 1.0)  # the same errors, the same successes
    assert row.metres_to_localize_p == pytest.approx(2 / 2**12, rel=1e-5)
    assert row.metres_to_localize_p_holm == pytest.approx(3 * 2 / 2**12, rel=1e-5)


def test_the_csv_files_have_the_columns_of_what_was_scored_and_no_others():
    rows = parsed(results_csv(ROWS, **FAILURES))
    assert rows[1]["success_1m"] == "0.75"
    assert rows[0]["metres_to_localize"] == "inf"
    assert float(rows[1]["metres_to_localize_diff"]) == -2.25
    assert "recovered" not in rows[0]
    assert "spl" not in rows[0]
    lines = parsed(report_cases.trials_csv(BLIND))
    assert [line["metres_to_localize"] for line in lines] == ["4.0", "inf", "8.0", "inf"]
    assert "success_1m" not in parsed(report_cases.trials_csv([finished("mcl", 0, 1.0)]))[0]


def tables_of(panel):
    found = ((group.name, journey_table(panel, group)) for group in GROUPS)
    return [(name, table) for name, table in found if table]


def test_the_report_has_a_table_and_a_curve_of_what_was_scored():
    panel = panel_of(ROWS, **FAILURES)
    ((group, table),) = tables_of(panel)
    assert group == "lost"
    lines = lines_of(table)
    assert [line[0] for line in lines] == ["mcl-plan", "mcl-map"]  # the largest share first
    assert lines[1][1] == "never"
    assert lines_of(verdict_table(panel))[1][1:4] == ["50 % (15 to 85)", "baseline", "–"]
    (chart,) = journey_charts(panel)
    blind, aware = chart.figure.axes[0].lines
    assert (blind.get_label(), aware.get_label()) == ("mcl-map", "mcl-plan")
    assert blind.get_xydata().tolist() == [[0, 0], [4, 25], [8, 50], [10, 50]]
    assert aware.get_ydata()[-1] == 75  # the failed run is not localized
    plain = panel_of([finished("mcl", 0, 1.0)])
    assert tables_of(plain) == journey_charts(plain) == []


def sought(method, found, error=2.0, score="success_1m"):
    records = [finished(method, world, error + 0.1 * world) for world in range(WORLDS)]
    return [whole(one, {score: float(w < found)}, 1.0) for w, one in enumerate(records)]


@pytest.mark.parametrize(
    ("score", "done"),
    [("success_1m", "localized to the end"), ("recovered", "recovered"), ("success", "arrived")],
)
def test_the_verdict_is_about_what_the_runs_are_about_not_about_the_error(score, done):
    # the errors rank them the other way round
    records = [*sought("mcl", 2, 1.0, score), *sought("amcl", 6, 3.0, score)]
    records += sought("mcl-plan", 11, 9.0, score)
    panel = panel_of(records)
    rows = parsed(results_csv(records))
    best, following = rows[2], rows[1]
    parts = (best[f"{score}_diff{end}"] for end in ("_low", "", "_high"))
    low, mean, high = (round(100 * float(part)) for part in parts)
    ends = [round(100 * one) for one in wilson(11 / 12, 12)]
    assert verdict_on(panel) == (
        f"mcl-plan is best: {done} in 92 % of runs (95 %: "
        f"{ends[0]} to {ends[1]}), {mean} percentage points above mcl (95 %: {low} to "
        f"{high}); costs 2.7 × the time."
    )
    assert float(following[f"{score}_p_holm"]) > 0.05
    table = verdict_table(panel).frame
    assert list(table["method"]) == ["mcl-plan", "amcl", "mcl (baseline)"]
    assert list(table["verdict"]) == ["better", "inconclusive", "baseline"]


def test_a_share_that_is_not_confirmed_to_be_larger_is_not_called_best():
    runs = [*sought("mcl", 6, score="recovered"), *sought("amcl", 8, score="recovered")]
    assert verdict_on(panel_of(runs)) == (
        "No method is confirmed to be better than mcl, recovered in 50 % of runs: first is amcl, "
        "recovered in 67 % of runs (95 %: 39 to 86), 17 percentage points above mcl "
        "(95 %: 0 to 42), p = 1."
    )


def test_a_glance_at_settings_shows_shares_beside_errors():
    plain = [finished(one, w, 2.0, scenario="sharp") for one in ("mcl", "amcl") for w in (0, 1)]
    glance = glance_table(report_cases.panels_of([*sought("mcl", 2), *sought("amcl", 11), *plain]))
    assert [line[1:] for line in lines_of(glance)] == [["17 %", "92 % ▲"], ["2.00", "2.00 ="]]
    assert list(glance.about["scores"]) == ["localized to the end (1 m, 30°)", "error e of x[t]"]
    assert list(glance.strong) == [(0, 2), (1, 1), (1, 2)]


def test_lost_robots_are_shown_by_when_they_were_localized():
    best, median_one, worst = films_of(panel_of(ROWS, **FAILURES))
    laps = [[run.key for run in lap.runs.values()] for lap in (best, median_one, worst)]
    assert laps == [[f"mcl-map-{world}-0", f"mcl-plan-{world}-0"] for world in (0, 1, 2)]
    assert "metres to localize of mcl-plan 2.0" in best.caption


def test_the_store_keeps_the_scores_of_whole_runs_and_refuses_what_are_none(tmp_path):
    key = TRIAL.key("code")
    with writing(tmp_path) as store:
        store.put(key, TRIAL, kept := record_of(BLIND[1]), 1.0)
        assert store.get(key, TRIAL).journey == kept.journey
        spoilt = whole(kept, {"success_1m": "yes"}, 1.0)
        words = r"expected float \| null, got str at record.journey.scores"
        with pytest.raises(ValueError, match=words):
            store.put(key, TRIAL, spoilt, 1.0)
        with pytest.raises(ValueError, match="whole run named 'fame'"):
            changed(kept.journey, scores=kept.journey.scores | {"fame": 1.0})


def run_of(world, way, distance, angle, *, name="mcl", off=0.0, segment=6.0, **params):
    place = {"world": {"segment": segment}, "assumed": {"prior.distance": off}, "params": params}
    record = changed(finished(name, world, 1.0, **place), unit="m")
    curves = {"way": way, "distance": distance, "angle": angle}
    return changed(record, journey=WholeRun(scores={}, curves=curves))


def test_a_run_is_localized_from_where_it_stays_near_to_its_end():
    way, near, astray = [0.0, 1.0, 2.0, 3.5], [0.2] * 4, [1.5] * 4
    expected = [  # distance, angle, metres and steps; within half of the segment
        (near, [0.1] * 4, 0.0, 0, 1),
        ([0.2, 1.5, 1.0, 0.2], [0.1] * 4, 2.0, 2, 1),
        (near, [0.1, 0.6, 0.6, 0.5], 3.5, 3, 0),
        (near, [0.1, 0.1, 0.1, 0.6], math.inf, math.inf, 0),
        (astray, [0.1] * 4, math.inf, math.inf, 0),
    ]
    runs = [run_of(w, way, *curves) for w, (*curves, _, _, _) in enumerate(expected)]
    for run, (*_, metres, steps, soon) in zip(runs, expected, strict=True):
        assert starts_table([run])[COLUMNS].to_numpy().tolist() == [[1, soon, metres, steps]]
    assert starts_table(runs)[COLUMNS].to_numpy().tolist() == [[5, 2, 3.5, 3]]


def test_ten_metres_are_soon_enough_however_long_a_run_is():
    for way, soon in ((9.9, 1), (10.1, 0)):
        run = run_of(0, [0.0, way], [3.0, 0.0], [0.0, 0.0], segment=50.0)
        assert starts_table([run])["localized"].tolist() == [soon]


def test_a_failed_run_is_never_localized_and_other_priors_have_no_row():
    run = run_of(0, [0.0], [0.0], [0.0])
    failed = replace(run.trial, trial=1)
    row = starts_table([run], [failed]).iloc[0]
    assert (row["runs"], row["localized"], row["metres_median"]) == (2, 1, math.inf)
    assert starts_table([finished("mcl", 0, 1.0)]).empty


def test_rows_are_by_localizer_and_error_and_name_what_else_was_swept():
    places = [("mcl", 1.0, 300), ("amcl", 0.0, 100), ("mcl", 0.0, 300), ("mcl", 1.0, 100)]
    there = [[0.0]] * 3  # at once
    runs = [run_of(0, *there, name=name, off=off, particles=n) for name, off, n in places]
    rows = starts_table(runs)[["localizer", "distance_m"]].to_numpy().tolist()
    many, few = "mcl particles 300", "mcl particles 100"
    assert rows == [[many, 0.0], [many, 1.0], ["amcl", 0.0], [few, 1.0]]
