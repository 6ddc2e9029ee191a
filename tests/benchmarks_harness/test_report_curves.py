"""Curves over what was swept."""

import xml.etree.ElementTree as ET
from itertools import product

import matplotlib as mpl
from hypothesis import given
from hypothesis import strategies as st
from report_cases import trials

from benchmarks.report.curves import DIFFERENCE, ERROR, swept_charts
from benchmarks.report.svg import HOUSE_STYLE, looks
from benchmarks.tables.panels import panels


def curves(records, quantity=ERROR):
    found = panels(records)
    look = looks(label for panel in found for label in panel.labels.values())
    with mpl.rc_context(HOUSE_STYLE):
        return swept_charts(found, look, quantity)


def words_of(chart):
    return " ".join(ET.fromstring(chart.standalone).itertext()).split()


def test_each_localizer_has_a_curve_and_a_difference_if_at_most_three_times_the_baselines_error():
    records = trials("ekf", [3.8] * 3) + trials("amcl", [4.0] * 3)  # mcl has 1.3 at N = 30
    for name, n in product(("mcl", "deq-mcl"), (30, 300)):
        records += trials(name, [1.0 + n / 100] * 3, params={"particles": n})
    (error,) = curves(records)
    assert error.title == "Error over particles"
    assert {"mcl", "deq-mcl", "ekf", "amcl", "30", "300"} <= set(words_of(error))
    (difference,) = curves(records, DIFFERENCE)
    assert difference.title == "Difference to the baseline over particles"
    assert difference.name == "difference-1"
    assert {"deq-mcl", "ekf"} <= set(words_of(difference))
    assert not {"mcl", "amcl"} & set(words_of(difference))
    assert difference.caption.endswith("Left out, above 3 times the baseline's error: amcl.")


def test_where_two_numbers_are_swept_there_is_a_chart_for_each_value_of_the_other():
    records = []
    for sigma, n in product((5.0, 20.0, 50.0), (100, 300)):
        records += trials("mcl", [1.0], params={"particles": n}, world={"lidar.sigma": sigma})
    assert [chart.title for chart in curves(records)] == [
        "Error over lidar.sigma: particles 100",
        "Error over lidar.sigma: particles 300",
        "Error over particles: lidar.sigma 5.0",
        "Error over particles: lidar.sigma 20.0",
        "Error over particles: lidar.sigma 50.0",
    ]


def test_where_only_one_value_was_run_there_is_no_chart():
    records = trials("mcl", [1.0], scenario="sharp", lag=5)
    for lag in (5, 20):
        records += trials("mcl", [1.0], scenario="matched", lag=lag)
    assert [chart.title for chart in curves(records)] == ["Error over lag L: matched"]


def test_what_changes_together_is_one_curve():
    records = []
    for noise in (0.1, 0.2):
        changes = {"world": {"noise.drive": noise}, "assumed": {"motion.drive": 2 * noise}}
        records += trials("mcl", [noise], **changes)
    (chart,) = curves(records)
    assert "noise.drive" in words_of(chart)
    assert chart.caption.endswith("Together with noise.drive change: assumed motion.drive.")


def test_of_several_that_change_together_the_axis_has_the_values_of_most():
    records = []
    for level in (0.1, 0.2, 0.4):
        noise = {"noise.drift": level / 10, "noise.drive": level, "noise.turn": level}
        records += trials("mcl", [level], world=noise)
    (chart,) = curves(records)
    assert chart.title == "Error over noise.drive"
    assert chart.caption.endswith("change: noise.drift, noise.turn.")


@given(st.integers(1, 15), st.integers(1, 5))
def test_labels_differ_in_colour_and_mark_as_far_as_there_are_colours_and_then_in_one(n, more):
    known = ["mcl", "deq-mcl"]
    found = looks([*known, *(f"mcl particles={10 * k}" for k in range(n - 1))])
    assert len({look.color for look in found.values()}) == min(len(found), 15)
    assert len({look.mark for look in found.values()}) == min(len(found), 15)
    many = looks([*known, *map(str, range(13 * more))])
    assert len({(look.color, look.mark) for look in many.values()}) == len(many)
    assert all(many[name] == look for name, look in looks(known).items())


def test_the_lag_and_the_parameter_of_that_name_are_one_curve():
    records = []
    for lag in (5, 20):
        records += trials("mcl", [1.0], lag=lag)
        records += trials("deq-mcl", [1.0], lag=lag, params={"lag": lag})
    (chart,) = curves(records)
    assert chart.title == "Error over lag L"


def test_words_seeds_and_single_values_make_no_curve():
    records = []
    for seed, kind in product((0, 1), ("systematic", "multinomial")):
        records += trials("mcl", [1.0], seed=seed, params={"resampler": kind, "particles": 10})
    assert curves(records) == []
