"""What a report says of made-up results."""

import re

import numpy as np
import pytest
from report_cases import finished, paired, results, trial_of

from benchmarks.report import words
from benchmarks.report.panels import panels, short_name
from benchmarks.report.rivals import gap_table, rival_tables
from benchmarks.report.style import looks
from benchmarks.tables.comparison import comparisons
from benchmarks.tables.gap import gaps
from benchmarks.tables.stats import paired_bootstrap

WORLDS = (0, 1, 2)


def panel_of(records):
    (panel,) = panels(comparisons(records), records)
    return panel


def said(records):
    return words.findings(panel_of(records))


ONE = (0,)


def test_a_clear_difference_is_called_smaller_or_larger_with_its_numbers():
    records = paired({"mcl": (20.0, ONE), "a": (16.0, ONE), "b": (24.0, ONE)}, worlds=25)
    better, worse = said(records)
    assert better.startswith("A has a smaller error than MCL (−4.")
    assert "smaller in 100 % of 25 worlds; p < 0.0001)" in better
    assert worse.startswith("B has a larger error than MCL (+")
    assert "smaller in 0 % of 25 worlds" in worse


def test_an_interval_around_zero_is_no_finding():
    records = paired({"mcl": (20.0, ONE)}, worlds=30)
    records += [
        finished("a", i, record["scores"][0]["error"] + (1.0 if i % 2 else -1.0))
        for i, record in enumerate(records)
    ]
    (sentence,) = said(records)
    assert sentence.startswith("A cannot be told from MCL by these worlds (+0.00,")


def test_an_interval_that_the_test_does_not_confirm_is_said_to_be_unconfirmed():
    records = paired({"mcl": (20.0, ONE), "a": (16.0, ONE)}, worlds=4)  # p is 0.125 at best
    unconfirmed, few = said(records)
    assert "the signed-rank test does not confirm it" in unconfirmed
    assert "p = 0.12" in unconfirmed
    assert few.startswith("These are only 4 worlds")


def test_the_same_error_everywhere_is_said_to_be_the_same():
    records = [finished(name, i, 5.0 + i) for name in ("mcl", "mcl-smoother") for i in range(30)]
    assert said(records) == [
        "MCL with smoother has exactly the error of MCL at x[t] in every world."
    ]


def test_one_world_decides_nothing():
    records = [finished("mcl", 0, 5.0), finished("a", 0, 1.0)]
    assert said(records) == ["A: −4.00 against MCL, but one world decides nothing."]


def test_worlds_that_are_not_shared_are_not_compared():
    (sentence, _) = said([finished("mcl", i, 5.0) for i in (0, 1)] + [finished("a", 2, 1.0)])
    assert sentence.endswith("have no finished world in common: nothing is compared.")


@pytest.mark.parametrize(("error", "warned"), [(4.0, True), (25.0, False)])
def test_it_is_said_when_dead_reckoning_wins(error, warned):
    records = paired({"mcl": (20.0, ONE), "dead-reckoning": (error, ONE)}, worlds=25)
    assert any("looks at no scan" in sentence for sentence in said(records)) == warned


def test_progress_says_n_of_n_and_what_is_missing():
    records = paired({"mcl": (20.0, ONE)}, worlds=3)
    assert words.progress(results(records)) == "3 of 3 trials finished."
    partial = results(records, failures=[(trial_of("x", 0), "boom")], missing=2)
    assert words.progress(partial) == (
        "3 of 6 trials finished, 1 failed, 2 not run yet: this report is partial."
    )


def test_the_overview_counts_localizers_settings_worlds_and_seeds():
    records = [
        finished(name, w, 1.0, filter_seed=s)
        for name in ("mcl", "deq-mcl")
        for w in range(3)
        for s in (0, 1)
    ]
    text = words.overview(results(records), [panel_of(records)])
    assert text.startswith(
        "2 localizers (MCL, DEQ-MCL) on 1 setting, 3 worlds per setting, each with 2 filter seeds."
    )


def test_what_is_not_available_reads_na_in_the_tables_never_nan():
    none = dict.fromkeys(("coverage_50", "coverage_80", "coverage_95", "nees", "entropy"))
    records = [finished(name, 0, 1.0, scores=none) for name in ("mcl", "dead-reckoning")]
    panel = panel_of(records)
    tables = (words.verdict_table, words.calibration_table, words.offsets_table)
    cells = [cell for table in tables for line in table(panel)[1] for cell in line]
    assert "n/a" in cells
    assert not [cell for cell in cells if re.search("nan|None", cell)]


def test_swept_parameters_make_panels_and_those_without_them_stand_in_each():
    records = [
        finished(name, 0, 1.0, params={"particles": n} | extra)
        for n in (100, 300)
        for name, extra in (("mcl", {}), ("deq-mcl", {"beta": 10.0}))
    ]
    records.append(finished("dead-reckoning", 0, 1.0))
    found = panels(comparisons(records), records)
    assert [panel.title for panel in found] == [
        "scenario paper, particles 100",
        "scenario paper, particles 300",
    ]
    for panel in found:
        assert list(panel.labels.values()) == ["mcl", "deq-mcl", "dead-reckoning"]
        assert [len(own) for own in panel.records.values()] == [1, 1, 1]


def test_a_parameter_that_one_method_lacks_leaves_it_in_every_panel():
    records = [finished("mcl", 0, 1.0, params={"particles": 100})]
    records += [
        finished("deq-mcl", 0, 1.0, params={"particles": 100, "beta": b}) for b in (0.0, "inf")
    ]
    found = panels(comparisons(records), records)
    assert [panel.title for panel in found] == [
        "scenario paper, beta 0.0",
        "scenario paper, beta inf",
    ]
    assert all(list(panel.labels.values()) == ["mcl", "deq-mcl"] for panel in found)


def test_settings_are_panels_named_by_what_sets_them_apart():
    records = [
        finished("mcl", 0, 1.0, world={"noise.drive": 0.1}),
        finished("mcl", 0, 1.0, assumed={"scan.sigma": 5.0}, lag=10),
        finished("mcl", 0, 1.0, disturbance=[{"kind": "kidnap", "step": 100}]),
    ]
    assert [panel.title for panel in panels(comparisons(records), records)] == [
        "scenario paper, noise.drive 0.1, L 20",
        "scenario paper, assumed scan.sigma 5.0, L 10",
        "scenario paper, kidnap step 100, L 20",
    ]


@pytest.mark.parametrize(
    ("name", "short"),
    [("deq-mcl", "deq-mcl"), ("./a b/mine.py:Mine", "Mine"), ("package.module:attr", "attr")],
)
def test_a_plug_in_is_called_by_its_class_in_pictures(name, short):
    assert short_name(name) == short


def test_plug_ins_of_the_same_class_name_are_called_in_full():
    records = [finished(name, 0, 1.0) for name in ("a.py:Mine", "b.py:Mine")]
    assert list(panel_of(records).labels.values()) == ["a.py:Mine", "b.py:Mine"]


def test_at_a_glance_every_error_has_the_mark_of_its_finding():
    records = paired({"mcl": (20.0, ONE), "a": (16.0, ONE), "b": (24.0, ONE)}, worlds=25)
    records += paired({"mcl": (20.0, ONE), "a": (16.0, ONE)}, worlds=4, scenario="sharp")
    header, lines = words.glance_table(panels(comparisons(records), records))
    assert header == ["setting", "mcl", "a", "b"]
    assert [line[0] for line in lines] == ["1. scenario paper", "2. scenario sharp"]
    assert [cell[-1] for cell in lines[0][2:]] == ["▼", "▲"]
    assert lines[0][1][-1].isdigit()  # the baseline
    assert [cell[-1] for cell in lines[1][2:]] == ["○", "–"]


def test_forms_of_a_localizer_stand_side_by_side_with_names_and_looks_of_their_own():
    forms = [("mcl-h", {}), ("mcl-h", {"form": "twisted"}), ("mcl", {})]
    records = [
        finished(name, 0, 1.0, params=params | {"particles": n})
        for n in (300, 1000)
        for name, params in forms
    ]
    found = panels(comparisons(records), records)
    assert [list(panel.labels.values()) for panel in found] == 2 * [
        ["mcl-h", "mcl-h form=twisted", "mcl"]
    ]
    look = looks(item for panel in found for item in panel.labels.items())
    one, other = (list(panel.labels) for panel in found)
    assert [look[method] for method in one] == [look[method] for method in other]
    assert len({look[method] for method in one}) == 3


def test_a_method_without_the_swept_parameter_is_compared_with_the_baseline_beside_it():
    records = [
        finished("mcl", w, e + w, params={"particles": n})
        for n, e in ((1, 9), (2, 5))
        for w in WORLDS
    ]
    records += [finished("ekf", w, 2.0 + w) for w in WORLDS]
    for panel, difference in zip(panels(comparisons(records), records), (-7.0, -3.0), strict=True):
        (row,) = [row for row in panel.present if row.method.localizer == "ekf"]
        assert row.baseline in panel.labels
        assert row.diff == difference


def test_the_rivals_are_the_papers_methods_at_both_offsets_and_pairs_are_of_one_world():
    both = (0, -20)
    records = [
        finished(name, w, e + w) for name, e in (("mcl", 5.0), ("mcl-map", 4.0)) for w in WORLDS
    ]
    records += [finished("deq-mcl", w, 3.0 + w, offsets=both) for w in (1, 2, 3)]
    records += [finished("mcl-pilots", w, 1.0 + w, offsets=both) for w in WORLDS]
    now, past = rival_tables(panel_of(records))
    assert now[0][2:] == [f"difference to {n}" for n in ("mcl", "mcl-map", "deq-mcl")]
    assert past[0][2:] == ["difference to deq-mcl"]
    mine = {line[0]: line for line in now[1]}["mcl-pilots"]
    assert mine[2:] == [f"−{d}.00 (−{d}.00 to −{d}.00)" for d in (4, 3, 2)]
    assert [line[0] for line in past[1]] == ["deq-mcl", "mcl-pilots"]


def test_coverage_and_nees_have_the_interval_over_worlds():
    records = [
        finished("mcl", w, 1.0, scores={"coverage_80": 0.7 + 0.1 * w, "nees": 3.0 + w})
        for w in WORLDS
    ]
    _, ((_, _, _, _, inside, _, nees, *_),) = words.calibration_table(panel_of(records))
    low, high = paired_bootstrap(np.array([70.0, 80.0, 90.0]))
    assert inside == f"80 % ({low:.0f} to {high:.0f})"
    assert nees.startswith("4.0 (3.")


def test_the_gap_table_has_the_limit_first_and_no_line_without_one():
    records = [finished("mcl", w, 5.0 + w) for w in WORLDS]
    limits = [finished("mcl-pilots", w, 3.0 + w, params={"particles": 9}) for w in (0, 1)]
    panel = panel_of(records)
    _, (limit, mcl) = gap_table(panel, gaps(records, limits))
    assert (limit[0], limit[-2:]) == ("limit: mcl-pilots particles=9", ["–", "2"])
    assert (mcl[0], mcl[-2:]) == ("mcl", ["+2.00 (2.00 to 2.00)", "2"])
    assert gap_table(panel, [])[1] == []
