"""Curves over what was swept, and the map of regimes where three numbers were."""

from dataclasses import replace
from itertools import product

import pytest
from report_cases import changed, panels_of, trials
from test_journey_tables import run

from benchmarks.pictures import styled
from benchmarks.report.charts import STYLE
from benchmarks.report.swept import swept_charts
from benchmarks.setup.overrides import Overrides
from benchmarks.tables.stats import wilson


@pytest.fixture(autouse=True)
def style():
    with styled(STYLE):
        yield


def curves(records):
    """The charts of the error and those of the difference."""
    charts = swept_charts(panels_of(records))
    return charts[::2], charts[1::2]


@pytest.mark.parametrize(("values", "scale"), [((10, 80), "log"), ((10, 70), "linear")])
def test_each_localizer_has_a_curve_and_a_difference_over_the_value_that_was_swept(values, scale):
    records = trials("dead-reckoning", [40.0, 40.0])
    for n in values:
        for name, error in (("mcl", 5.0), ("deq-mcl", 30.0 / n)):
            records += trials(name, [error, error + 1], params={"particles": n})
    (error,), (difference,) = curves(records)
    assert (error.title, error.name) == ("Error over particles", "curve-1")
    assert (difference.title, difference.name) == ("Difference over particles", "difference-1")
    for chart, column, labels in (
        (error, "error", ["mcl", "deq-mcl", "dead-reckoning"]),
        (difference, "diff", ["deq-mcl", "dead-reckoning"]),
    ):
        (axes,) = chart.figure.axes
        drawn = {one.get_label(): one.get_xydata().tolist() for one in axes.lines}
        rows = [panel.present.set_index("label") for panel in panels_of(records)]
        for label in labels:
            own = [float(one.loc[label, column]) for one in rows]
            assert drawn[label] == [list(point) for point in zip(values, own, strict=True)]
        assert axes.get_xscale() == scale
        assert [tick.get_text() for tick in axes.get_xticklabels()] == [f"{v:g}" for v in values]
    # what is far worse than the baseline would hide all other differences
    assert difference.figure.axes[0].get_ylim()[1] <= 3 * 5.5


def test_where_two_numbers_are_swept_there_is_a_chart_for_each_value_of_the_other():
    records = []
    for sigma, n in product((5.0, 20.0, 50.0), (100, 300)):
        records += trials("mcl", [1.0], params={"particles": n}, world={"lidar.sigma": sigma})
    assert [chart.title for chart in curves(records)[0]] == [
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
    assert [chart.title for chart in curves(records)[0]] == ["Error over lag: scenario matched"]


def test_what_changes_together_is_one_curve_over_what_has_the_values_of_most():
    records = []
    for level in (0.1, 0.2, 0.4):
        world = {"noise.drift": level / 10, "noise.drive": level, "noise.turn": level}
        records += trials("mcl", [level], world=world, assumed={"motion.drive": 2 * level})
    (chart,), _ = curves(records)
    assert chart.title == "Error over noise.drive"
    (axes,) = chart.figure.axes
    others = "noise.drift, noise.turn, assumed.motion.drive"
    assert axes.get_xlabel() == f"noise.drive (with {others})"


def test_the_lag_and_the_parameter_of_that_name_are_one_curve():
    records = []
    for lag in (5, 20):
        records += trials("mcl", [1.0], lag=lag)
        records += trials("deq-mcl", [1.0], lag=lag, params={"lag": lag})
    (chart,), _ = curves(records)
    assert chart.title == "Error over lag"


def test_words_seeds_and_single_values_make_no_curve():
    records = []
    for seed, kind in product((0, 1), ("systematic", "multinomial")):
        records += trials("mcl", [1.0], seed=seed, params={"resampler": kind, "particles": 10})
    assert swept_charts(panels_of(records)) == []


BEAMS, WIDTHS, LENGTHS = (1, 4), (1.2, 3.2), ((8.0, 12.0), (40.0, 60.0))
WORLDS = 12


def at(record, beams, width, length):
    world = {
        "floor_plan.office.corridor": width,
        "lidar.beams": beams,
        "route.max_length": length[1],
        "route.min_length": length[0],
    }
    return changed(record, trial=replace(record.trial, world=Overrides(world)))


def regimes(lengths=LENGTHS):
    """The plan pays with long routes and four beams, and costs with long routes and one."""
    records = []
    for beams, width, length in product(BEAMS, WIDTHS, lengths):
        for world in range(WORLDS):
            ahead = 0.0 if length == LENGTHS[0] else 6.0 if beams == 4 else -6.0
            for method, metres in (("mcl-map", 7.0), ("mcl-plan", 7.0 - ahead)):
                found = run(method, world, metres, success=float(metres < 7 + (world % 2)))
                records.append(at(found, beams, width, length))
    return panels_of(records, baseline="mcl-map")


def test_three_numbers_give_a_map_for_each_tested_score_whose_cells_have_the_difference():
    success, metres = charts = swept_charts(regimes())
    assert [one.name for one in charts] == ["regimes-success-1m-1", "regimes-metres-to-localize-1"]
    cells = [text.get_text() for axes in metres.figure.axes for text in axes.texts]
    assert len(metres.figure.axes) == 2  # short routes, long routes
    assert cells.count("−6.0 *\n(−6.0 to −6.0)") == 2  # four beams, long routes, both widths
    assert cells.count("+3.0 *\n(3.0 to 3.0)") == 2  # 10 m were driven at most
    assert cells.count("+0.0\n(0.0 to 0.0)") == 4
    points = [text.get_text().split()[0] for axes in success.figure.axes for text in axes.texts]
    assert (points.count("+50"), points.count("−50"), points.count("+0")) == (2, 2, 4)


def test_two_numbers_give_a_map_of_shares_whose_cells_are_bold_where_most_runs_are():
    (chart,) = swept_charts(regimes(LENGTHS[1:]))
    assert chart.title.startswith("Runs localized to the end (")  # what they are about, not e
    first, second = chart.figure.axes
    assert [axes.get_title() for axes in (first, second)] == ["mcl-map", "mcl-plan"]
    assert [axes.get_xlabel() for axes in (first, second)] == ["floor_plan.office.corridor"] * 2
    cells = {(*map(int, t.get_position()), t.get_weight()): t.get_text() for t in second.texts}
    low, high = (f"{100 * end:.0f}" for end in wilson(1.0, WORLDS))
    assert cells == {
        (x, y, "bold" if y else "normal"): f"100 %\n({low} to {high})"
        if y
        else cells[x, 0, "normal"]
        for x in (0, 1)
        for y in (0, 1)
    }
    assert cells[0, 0, "normal"].startswith("0 %")
