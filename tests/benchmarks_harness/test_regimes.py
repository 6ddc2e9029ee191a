"""The map of regimes: which panels have one, and what stands in its cells."""

import re
from dataclasses import replace
from itertools import product

import matplotlib as mpl
import pytest
from report_cases import changed
from test_journey_tables import run

from benchmarks.report.svg import HOUSE_STYLE, looks
from benchmarks.report.swept import charts_over, regime_maps
from benchmarks.setup.changes import Changes
from benchmarks.tables.panels import panels

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


def swept(lengths=LENGTHS):
    """The plan pays with long routes and four beams, and costs with long routes and one."""
    records = []
    for beams, width, length in product(BEAMS, WIDTHS, lengths):
        for world in range(WORLDS):
            ahead = 0.0 if length == LENGTHS[0] else 6.0 if beams == 4 else -6.0
            for method, metres in (("mcl-map", 7.0), ("mcl-plan", 7.0 - ahead)):
                found = run(method, world, metres, success=float(metres < 7 + (world % 2)))
                records.append(at(found, beams, width, length))
    return panels(records, "mcl-map")


@pytest.fixture(autouse=True)
def house_style():
    with mpl.rc_context(HOUSE_STYLE):
        yield


def words(picture):
    return [" ".join(found.split()) for found in re.findall(r"<text[^>]*>([^<]*)<", picture.source)]


def test_three_numbers_give_a_map_for_each_tested_score_and_no_curves():
    drawn = regime_maps(swept())
    assert [one.name for one in drawn] == ["regimes-success-1m-1", "regimes-metres-to-localize-1"]
    look = looks(["mcl-map", "mcl-plan"])
    assert [one.name for one in charts_over(swept(), look)] == [one.name for one in drawn]


def test_a_cell_has_the_difference_its_interval_and_both_values():
    success, metres = map(words, regime_maps(swept()))
    assert metres.count("−6.0") == 2  # four beams, long routes, both widths
    assert metres.count("+3.0") == 2  # 10 m were driven at most
    assert metres.count("+0.0") == 4
    assert metres.count("7.0 → 1.0 m") == metres.count("7.0 → 10.0 m") == 2
    assert success.count("50 → 100 %") == success.count("50 → 0 %") == 2
    for told in (success, metres):
        assert told.count("floor_plan.office.corridor") == 2
        assert told.count("max_length 60.0, min_length 40.0") == 1


def test_it_counts_where_the_method_is_clearly_ahead_and_where_behind():
    _, metres = regime_maps(swept())
    assert metres.alt.endswith("ahead of the baseline in 2 of 8 settings, clearly behind in 2.")


def test_two_numbers_are_drawn_as_curves():
    few = swept(LENGTHS[:1])
    assert regime_maps(few) == []
    titles = [one.title for one in charts_over(few, looks(["mcl-map", "mcl-plan"]))]
    assert titles[0].startswith("Runs localized to the end over ")  # what they are about, not e
