"""Animations and charts: what is drawn can be seen, and is what it is said to be."""

import math
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from fake_episode import FakeBelief
from report_cases import THREE, changed, finished, panel_of, panels_of, trial_of, trials
from test_journey_tables import run

from benchmarks.report import charts, films
from benchmarks.report.charts import Chart, line, styled, swept_charts
from benchmarks.report.films import Animation, Camera, Film, films_of
from benchmarks.setup.overrides import Overrides
from benchmarks.tables.frames import errors_by_offset
from benchmarks.tables.stats import wilson
from benchmarks.trials.episode import Step
from benchmarks.trials.stage import key_of
from deqmcl_gym.maps import PolygonMap
from deqmcl_gym.world.drawing import View

HALL = PolygonMap(outer=[(0, 0), (60, 0), (60, 40), (0, 40)], unit="m")
BLUE, GREEN, GRAY, ORANGE = (0, 114, 178), (0, 158, 115), (128, 128, 128), (255, 140, 0)
STEPS, FOUND = 12, 7
# without mcl the first method is the baseline: here a variant of the same localizer
FORMS = ("systematic", "stratified")
BEAMS, WIDTHS, LENGTHS = (1, 4), (1.2, 3.2), ((8.0, 12.0), (40.0, 60.0))
WORLDS = 12


def episode(rng):
    """A drive along y = 10 with 20,000 particles, anywhere until they are at the truth."""
    for step in range(STEPS + 1):
        truth = np.array([10.0 + step, 10.0, 0.0])
        wrong = np.array([40.0, 30.0, 0.0])
        cloud = (truth if step >= FOUND else wrong) + rng.normal(0, 0.3, (20_000, 3))
        belief = FakeBelief({0: (cloud, np.full(20_000, 1 / 20_000))})
        plan = np.array([[1.0, 0.0]] * 20)
        action = np.array([1.0, 0.0]) if step else None
        yield Step(step, truth, np.empty(0), belief, 0.0, action, plan)


def filmed():
    film = Film(Camera(View(HALL, 0.2), 0.25, 0), "mcl", 4)
    assert len(list(film.of(episode(np.random.default_rng(0))))) == STEPS + 1
    return film


def has(image, color, place, within=8):
    column, row = np.rint(View(HALL, 0.2).pixels([place])[0]).astype(int)
    seen = image[row - within : row + within + 1, column - within : column + within + 1]
    return (np.abs(seen.astype(int) - color) < 60).all(axis=-1).any()  # thin lines are blended


def test_every_frame_shows_truth_best_cluster_cloud_and_plan_in_a_building():
    film = filmed()
    assert len(film.frames) == 4 + 1
    assert len({frame.shape for frame in film.frames}) == 1
    for step, frame in zip((0, 4, 8, 12, 12), film.frames, strict=True):
        x = 10 + step
        believed = (x, 10) if step >= FOUND else (40, 30)
        assert has(frame, GRAY, (x, 10))
        assert has(frame, BLUE, believed)
        assert has(frame, ORANGE, believed)
        assert has(frame, GREEN, (x + 15, 10))
        assert not has(frame, GREEN, (x + 25, 10))


def test_the_last_frame_has_the_way_of_the_best_cluster():
    *_, before, last = filmed().frames
    assert has(last, BLUE, (40, 30))
    assert not has(before, BLUE, (40, 30))


def shown(lap):
    """Resampler, world and filter seed of the trials of an animation, side by side."""
    trials = [run.trial for run in lap.runs.values()]
    return [(dict(t.params)["resampler"], t.trial, t.filter_seed) for t in trials]


def form(resampler, world, error, seed=0):
    return finished("mcl-pilots", world, error, params={"resampler": resampler}, filter_seed=seed)


def test_variants_of_one_localizer_are_animated_each_by_its_own_first_trial():
    cases = product((0, 1), enumerate(FORMS), (0, 1))
    records = [form(one, world, 1.0 + i + world, seed) for seed, (i, one), world in cases]
    best, *_ = films_of(panel_of(records))
    assert shown(best) == [("systematic", 0, 0), ("stratified", 0, 0)]
    assert "mcl-pilots resampler=systematic and mcl-pilots resampler=stratified" in best.caption


def test_a_baseline_without_a_trial_on_the_world_is_not_named():
    records = [form("systematic", 1, 1.0), form("stratified", 1, 3.0), form("stratified", 0, 2.0)]
    best, *_ = films_of(panel_of(records))
    assert shown(best) == [("stratified", 0, 0)]
    assert best.caption.startswith("World 0, mcl-pilots resampler=stratified: error")


def test_a_hedge_is_animated_beside_a_method_that_sees_no_plan():
    same = trial_of("mcl", 0, scenario="guided", params={"particles": 20}, lag=0)
    trials = {"a": same, "b": replace(same, localizer="mcl-plan-hedged")}
    runs = {name: SimpleNamespace(trial=one, key=key_of(one)) for name, one in trials.items()}
    lap = Animation(name="lap", title="", caption="", runs=runs)
    assert films.filmed(lap).webp.startswith(b"RIFF")


@pytest.fixture(autouse=True)
def style():
    with styled():
        yield


@pytest.fixture(scope="module")
def panel():
    """Three methods on five worlds: of other errors, past errors and profiles."""
    records = []
    for place, (name, (_, offsets)) in enumerate(THREE.items()):
        for world in range(5):
            error = {k: 2.0 + place + world**2 + abs(k) / 10 + (k > 0) for k in offsets}
            records.append(finished(name, world, error))
    return panel_of(records)


def test_charts_of_a_panel_draw_its_numbers(panel):
    (axes,) = charts.offset_chart(panel).figure.axes
    offsets = {one.get_label(): one.get_xydata().tolist() for one in axes.lines}
    for row in panel.present.itertuples():
        held = errors_by_offset(panel.records[row.label])
        assert offsets[row.label] == held[["offset", "mean"]].to_numpy().tolist()


def test_a_label_looks_the_same_in_every_chart_and_others_have_another_look():
    labels = [f"method {n}" for n in range(40)]
    frame = pd.DataFrame({"label": pd.Categorical(labels, categories=labels), "x": 1.0, "y": 2.0})
    looks = [(one.get_color(), one.get_marker()) for one in line(frame, "x", "y").lines]
    assert len(set(looks)) == 40
    part = frame[frame["label"].isin(labels[7:9])]
    assert [(one.get_color(), one.get_marker()) for one in line(part, "x", "y").lines] == looks[7:9]


@pytest.mark.parametrize("names", [1, 2, 3, 4, 5, 7])
@pytest.mark.parametrize("letters", [4, 22, 50, 120])
def test_every_name_of_a_legend_is_inside_the_picture_and_below_the_axes(names, letters):
    labels = [f"{number} {'plan_beta=0.1 ' * 9}"[:letters].strip() for number in range(names)]
    frame = pd.DataFrame({"label": labels, "x": 1.0, "y": 2.0})
    axes = line(frame, "x", "y")
    axes.set_xlabel("driven, m")
    chart = Chart("", "", "", axes.figure)
    chart.figure.draw_without_rendering()
    (legend,) = chart.figure.legends
    shown, below = legend.get_window_extent(), axes.xaxis.get_tightbbox()
    assert [text.get_text().replace("\n", " ") for text in legend.get_texts()] == labels
    assert math.ceil(shown.x0) >= 0
    assert shown.x1 <= chart.figure.bbox.width
    assert 0 <= shown.y0 < shown.y1 <= below.y0


@pytest.mark.parametrize(("values", "scale"), [((10, 80), "log"), ((10, 70), "linear")])
def test_each_localizer_has_a_curve_over_the_value_that_was_swept(values, scale):
    records = trials("dead-reckoning", [40.0, 40.0])
    for n in values:
        for name, error in (("mcl", 5.0), ("deq-mcl", 30.0 / n)):
            records += trials(name, [error, error + 1], params={"particles": n})
    panels = panels_of(records)
    (chart,) = swept_charts(panels)
    assert (chart.title, chart.name) == ("Error over particles", "curve-1")
    (axes,) = chart.figure.axes
    drawn = {one.get_label(): one.get_xydata().tolist() for one in axes.lines}
    rows = [panel.present.set_index("label") for panel in panels]
    for label in ("mcl", "deq-mcl", "dead-reckoning"):
        own = [float(one.loc[label, "error"]) for one in rows]
        assert drawn[label] == [list(point) for point in zip(values, own, strict=True)]
    assert axes.get_xscale() == scale
    assert [tick.get_text() for tick in axes.get_xticklabels()] == [f"{v:g}" for v in values]


def test_where_two_numbers_are_swept_there_is_a_chart_for_each_value_of_the_other():
    records = []
    for sigma, n in product((5.0, 20.0, 50.0), (100, 300)):
        records += trials("mcl", [1.0], params={"particles": n}, world={"lidar.sigma": sigma})
    assert [chart.title for chart in swept_charts(panels_of(records))] == [
        "Error over lidar.sigma: particles 100",
        "Error over lidar.sigma: particles 300",
        "Error over particles: lidar.sigma 5.0",
        "Error over particles: lidar.sigma 20.0",
        "Error over particles: lidar.sigma 50.0",
    ]


def test_what_changes_together_is_one_curve_over_what_has_the_values_of_most():
    records = []
    for level in (0.1, 0.2, 0.4):
        world = {"noise.drift": level / 10, "noise.drive": level, "noise.turn": level}
        records += trials("mcl", [level], world=world, assumed={"motion.drive": 2 * level})
    (chart,) = swept_charts(panels_of(records))
    assert chart.title == "Error over noise.drive"
    (axes,) = chart.figure.axes
    others = "noise.drift, noise.turn, assumed.motion.drive"
    assert axes.get_xlabel() == f"noise.drive (with {others})"


def test_the_lag_and_the_parameter_of_that_name_are_one_curve():
    records = []
    for lag in (5, 20):
        records += trials("mcl", [1.0], lag=lag)
        records += trials("deq-mcl", [1.0], lag=lag, params={"lag": lag})
    (chart,) = swept_charts(panels_of(records))
    assert chart.title == "Error over lag"


def test_words_seeds_and_single_values_make_no_curve():
    records = []
    for seed, kind in product((0, 1), ("systematic", "multinomial")):
        records += trials("mcl", [1.0], seed=seed, params={"resampler": kind, "particles": 10})
    assert swept_charts(panels_of(records)) == []


def at(record, beams, width, length):
    routes = {"route.max_length": length[1], "route.min_length": length[0]}
    world = {"floor_plan.office.corridor": width, "lidar.beams": beams} | routes
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
    assert [cells.pop((x, 1, "bold")) for x in (0, 1)] == [f"100 %\n({low} to {high})"] * 2
    assert {*cells} == {(0, 0, "normal"), (1, 0, "normal")}
    assert cells[0, 0, "normal"].startswith("0 %")
