"""Curves over what was swept, and the map of regimes where three numbers were."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_cases import changed, trials
from test_journey_tables import run

from benchmarks.pictures import styled
from benchmarks.report.curves import DIFFERENCE, ERROR, swept_charts
from benchmarks.report.svg import HOUSE_STYLE, looks
from benchmarks.report.swept import charts_over, regime_maps
from benchmarks.setup.changes import Changes
from benchmarks.tables.panels import panels


@pytest.fixture(autouse=True)
def house_style():
    with styled(HOUSE_STYLE):
        yield


def curves(records, quantity=ERROR):
    found = panels(records)
    look = looks(name for one in found for name in one.labels.values())
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
        "Error over σ of the lidar: particles 100",
        "Error over σ of the lidar: particles 300",
        "Error over particles: σ of the lidar 5",
        "Error over particles: σ of the lidar 20",
        "Error over particles: σ of the lidar 50",
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
    assert ">noise of drive<" in chart.standalone
    assert chart.caption.endswith("Together with noise of drive change: assumed noise of drive.")


def test_of_several_that_change_together_the_axis_has_the_values_of_most():
    records = []
    for level in (0.1, 0.2, 0.4):
        noise = {"noise.drift": level / 10, "noise.drive": level, "noise.turn": level}
        records += trials("mcl", [level], world=noise)
    (chart,) = curves(records)
    assert chart.title == "Error over noise of drive"
    assert chart.caption.endswith("change: noise of drift, noise of turn.")


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


BEAMS, WIDTHS, LENGTHS = (1, 4), (1.2, 3.2), ((8.0, 12.0), (40.0, 60.0))
WORLDS = 12


def at(record, beams, width, length):
    world = {
        "floor_plan.office.corridor": width,
        "lidar.beams": beams,
        "route.max_length": length[1],
        "route.min_length": length[0],
    }
    return changed(record, trial=replace(record.trial, world=Changes(world)))


def regimes(lengths=LENGTHS):
    """The plan pays with long routes and four beams, and costs with long routes and one."""
    records = []
    for beams, width, length in product(BEAMS, WIDTHS, lengths):
        for world in range(WORLDS):
            ahead = 0.0 if length == LENGTHS[0] else 6.0 if beams == 4 else -6.0
            for method, metres in (("mcl-map", 7.0), ("mcl-plan", 7.0 - ahead)):
                found = run(method, world, metres, success=float(metres < 7 + (world % 2)))
                records.append(at(found, beams, width, length))
    return panels(records, "mcl-map")


def cells(picture):
    return [" ".join(found.split()) for found in re.findall(r"<text[^>]*>([^<]*)<", picture.source)]


def test_three_numbers_give_a_map_for_each_tested_score_and_no_curves():
    drawn = regime_maps(regimes())
    assert [one.name for one in drawn] == ["regimes-success-1m-1", "regimes-metres-to-localize-1"]
    look = looks(["mcl-map", "mcl-plan"])
    assert [one.name for one in charts_over(regimes(), look)] == [one.name for one in drawn]


def test_a_cell_has_the_difference_its_interval_and_both_values():
    success, metres = map(cells, regime_maps(regimes()))
    assert metres.count("−6.0") == 2  # four beams, long routes, both widths
    assert metres.count("+3.0") == 2  # 10 m were driven at most
    assert metres.count("+0.0") == 4
    assert metres.count("7.0 → 1.0 m") == metres.count("7.0 → 10.0 m") == 2
    assert success.count("50 → 100 %") == success.count("50 → 0 %") == 2
    for told in (success, metres):
        assert told.count("width of corridors, m") == 2
        assert told.count("length of the route 40 to 60 m") == 1


def test_it_counts_where_the_method_is_clearly_ahead_and_where_behind():
    _, metres = regime_maps(regimes())
    assert metres.alt.endswith("ahead of the baseline in 2 of 8 settings, clearly behind in 2.")


def test_two_numbers_are_drawn_as_curves():
    few = regimes(LENGTHS[:1])
    assert regime_maps(few) == []
    titles = [one.title for one in charts_over(few, looks(["mcl-map", "mcl-plan"]))]
    assert titles[0].startswith("Runs localized to the end over ")  # what they are about, not e
