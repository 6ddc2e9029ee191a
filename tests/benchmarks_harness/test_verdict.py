"""Who is best, in words that agree with results.csv; how many worlds it takes to say so."""

import math
import re

import numpy as np
import pytest
from report_cases import paired, parsed, results, trials, written

from benchmarks.report.words import conclusion, power_hint, runner_up, spoken
from benchmarks.tables.panels import panels
from benchmarks.tables.stats import (
    holm,
    least_p,
    least_worlds,
    relative_change,
    wilcoxon,
    worlds_to_see,
    worth_seeing,
)

ONE = (0,)


def said(records):
    (panel,) = panels(records)
    return spoken(panel)


def test_the_verdict_has_the_numbers_of_results_csv_and_timings_csv(tmp_path):
    records = paired({"mcl": (20.0, ONE), "mcl-map": (15.0, ONE), "grid": (17.0, ONE)}, worlds=30)
    written(tmp_path, results(records))
    rows = {row["method"]: row for row in parsed((tmp_path / "results.csv").read_text())}
    times = parsed((tmp_path / "timings.csv").read_text())
    spent = {row["method"]: float(row["ms_per_step"]) for row in times}
    best = rows["mcl-map"]
    low, mean, high = (-100 * float(best[f"relative{end}"]) for end in ("_high", "", "_low"))
    expected = (
        f"Map-based MCL is best: {float(best['error']):.1f} px, {mean:.0f} % "
        f"below MCL (95 %: {low:.0f} to {high:.0f}), smaller in "
        f"{float(best['win_rate']) * int(best['paired_worlds']):g} of 30 worlds; costs "
        f"{spent['mcl-map'] / spent['mcl']:.2g} × the time."
    )
    assert float(best["relative"]) == pytest.approx(
        float(best["diff"]) / float(rows["mcl"]["error"])
    )
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert re.search('<p class="verdict">(.*?)</p>', page)[1] == expected
    assert expected in (tmp_path / "results.md").read_text(encoding="utf-8").replace("\\", "")
    assert conclusion(results(records)) == expected


CASES = {
    "MCL: 20.0 px; nothing to compare it with.": {"mcl": [20.0] * 9},
    "No method is better than the baseline, MCL: 20.0 px.": {"mcl": [20.0] * 9, "a": [21.0] * 9},
    "No method is confirmed to be better than MCL (20.0 px). Smallest error: a, 16.0 px, "
    "20 % below (95 %: 20 to 20), smaller in 5 of 5 worlds; 5 worlds cannot give p < 0.05 in 1 "
    "test, 6 can.": {"mcl": [20.0] * 5, "a": [16.0] * 5},
    "No method is confirmed to be better than MCL (20.0 px). Smallest error: a, 19.0 px, "
    "5.0 % below (95 %: −1.2 to 11.6), smaller in 5 of 8 worlds; p = 0.25.": {
        "mcl": [20.0] * 8,
        "a": [16.0, 17, 18, 18.5, 19.5, 20.5, 21, 21.5],
    },
    "Dead reckoning on the plan is best: 9.00 px, 55 % below MCL (95 %: 55 to 55), smaller in 9 of "
    "9 worlds; costs 4.7 × the time. Of the methods that use scans, a is best: 16.0 px, 20 % below "
    "MCL (95 %: 20 to 20), smaller in 9 of 9 worlds; costs 0.33 × the time.": {
        "mcl": [20.0] * 9,
        "dead-reckoning": [9.0] * 9,
        "a": [16.0] * 9,
    },
    "A is best: 16.0 px, 20 % below MCL (95 %: 20 to 20), smaller in 9 of 9 worlds; costs 0.33 × "
    "the time.": {"mcl": [20.0] * 9, "a": [16.0] * 9},
    "A is best: 16.0 px, 20 % below MCL (95 %: 20 to 20), smaller in 9 of 9 worlds; costs 0.33 × "
    "the time (b has 14.4 px, which is not confirmed).": {
        "mcl": [20.0] * 9,
        "a": [16.0] * 9,
        "b": [1.0, 1, 1, 1, 21, 22, 27, 27, 29],
    },
}


@pytest.mark.parametrize("expected", CASES)
def test_the_verdict_says_only_what_is_known(expected):
    assert said([one for name, e in CASES[expected].items() for one in trials(name, e)]) == expected


def test_of_several_settings_it_is_counted_who_is_best():
    records = paired({"mcl": (20.0, ONE), "deq-mcl": (16.0, ONE)})
    records += paired({"mcl": (20.0, ONE), "deq-mcl": (24.0, ONE)}, scenario="sharp")
    assert conclusion(results(records)) == (
        "Of 2 settings, DEQ-MCL is best in 1; in 1 no method is confirmed to be better than MCL."
    )
    assert conclusion(results(records[-2:] + records[:2])).startswith("In none of 2 settings")
    assert conclusion(results([])) == "No trial is finished."


def test_the_next_method_is_named_with_what_it_is_behind():
    (panel,) = panels(trials("mcl", [20.0] * 9) + trials("a", [16.0] * 9) + trials("b", [17.0] * 9))
    assert runner_up(panel) == "Next is b, 17.0 px: 1.00 px behind (95 %: 1.00 to 1.00)."
    (panel,) = panels(trials("mcl", [20.0] * 9) + trials("a", [16.0] * 9))
    assert runner_up(panel) == ""  # the sentence before has it


@pytest.mark.parametrize("tests", [1, 2, 5, 9])
def test_the_least_p_is_that_of_the_exact_test_and_holm(tests):
    for worlds in range(2, 12):
        one_sided = wilcoxon(np.arange(1.0, worlds + 1))
        assert least_p(worlds, tests) == min(holm([one_sided, *[1.0] * (tests - 1)]))
        assert (worlds >= least_worlds(tests)) == (least_p(worlds, tests) < 0.05)


@pytest.mark.parametrize(("sd", "tests"), [(1.0, 1), (2.0, 1), (1.5, 5)])
def test_so_many_worlds_find_the_difference_in_four_of_five_experiments(sd, tests):
    worlds = worlds_to_see(1.0, sd, tests)
    rng = np.random.default_rng(0)
    repeats = 1500  # SD of the share: 0.0103
    found = [
        wilcoxon(1.0 + sd * rng.standard_normal(worlds)) < 0.05 / tests for _ in range(repeats)
    ]
    assert np.mean(found) == pytest.approx(0.8, abs=0.045)
    fewer = [
        wilcoxon(1.0 + sd * rng.standard_normal(worlds * 2 // 3)) < 0.05 / tests
        for _ in range(repeats)
    ]
    assert np.mean(fewer) < 0.72


def test_a_round_difference_is_near_a_twentieth_of_the_error():
    assert [worth_seeing(e) for e in (20.0, 12.0, 0.8, 0.2)] == pytest.approx([1, 0.5, 0.05, 0.01])
    assert math.isnan(worth_seeing(0.0))


def test_the_hint_names_a_number_of_worlds_for_every_method_that_differs():
    records = paired({"mcl": (20.0, ONE), "a": (19.9, ONE)}) + trials("b", [20.0] * 12)
    (panel,) = panels(records)
    assert re.fullmatch(
        r"Worlds needed to detect a difference of 1 px to MCL with 80 % power: about [\d,]+ for a, "
        r"[\d,]+ for b\.",
        power_hint(panel),
    )


def test_a_relative_change_is_a_ratio_of_means_with_an_interval_that_covers():
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(200):
        reference = 20 + 4 * rng.standard_normal(40)
        low, high = relative_change(-0.3 * reference + rng.standard_normal(40), reference)[1:]
        inside += low <= -0.3 <= high
    assert inside >= 178  # 190 expected; fewer than this in 1 of 10,000 runs
