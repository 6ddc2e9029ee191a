"""Charts of frames: what is drawn can be seen, and is what it is said to be."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from report_cases import THREE, finished, panel_of, trials

from benchmarks.pictures import styled
from benchmarks.report import charts
from benchmarks.report.charts import STYLE, Chart, line
from benchmarks.tables.frames import errors_by_offset

NAMES = ("points", "offset", "lap")


@pytest.fixture(autouse=True)
def style():
    with styled(STYLE):
        yield


def drawn_in(axes):
    """What is drawn under each label: places, heights, and the ends of the bars, one by one."""
    bars = [tuple(map(tuple, way.tolist())) for c in axes.collections for way in c.get_segments()]
    return {one.get_label(): one.get_xydata().tolist() for one in axes.lines}, bars


@settings(deadline=None, max_examples=15, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.floats(0, 1), min_size=2, max_size=40), st.sampled_from([0.0, 1e-3, 1.0, 1e6]))
def test_every_mark_and_bar_of_every_chart_is_inside_its_axes(shares, size):
    errors = [size * (1 + share) for share in shares]
    records = [one for name, (_, k) in THREE.items() for one in trials(name, errors, offsets=k)]
    panel = panel_of(records)
    for name in NAMES[:-1]:
        (axes,) = getattr(charts, f"{name}_chart")(panel).figure.axes
        (left, right), ends = axes.get_xlim(), sorted(axes.get_ylim())
        marked = [one for one in axes.lines if one.get_marker() not in ("None", "")]
        places = [place for one in marked for place in one.get_xydata().tolist()]
        places += [end for bar in drawn_in(axes)[1] for end in bar]
        assert places, name
        assert all(left <= x <= right and ends[0] <= y <= ends[1] for x, y in places), name


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
    rows = panel.present
    axes = {name: getattr(charts, f"{name}_chart")(panel).figure.axes[0] for name in NAMES}
    for row in rows.itertuples():
        held = errors_by_offset(panel.records_by_label[row.label])
        offsets, _ = drawn_in(axes["offset"])
        assert offsets[row.label] == [[k, one.mean] for k, one in held.items()]
        lap, _ = {one.get_label(): set(one.get_ydata()) for one in axes["lap"].lines}, None
        assert lap[row.label] == {row.error}
    low, high = np.quantile([2.0, 3.0, 6.0, 11.0, 18.0], [0.1, 0.9])
    heights = axes["lap"].collections[0].get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == pytest.approx((low, high))


def test_every_mark_of_every_world_is_where_the_line_of_its_world_is():
    rng = np.random.default_rng(0)
    records = [finished(n, w, rng.uniform(1, 9)) for n in ("mcl", "deq-mcl") for w in range(40)]
    axes = charts.points_chart(panel_of(records)).figure.axes[0]
    drawn = [one.get_xydata() for one in axes.lines]
    worlds, marks = np.array(drawn[:40]), [one for one in drawn[40:] if len(one) == 40]
    assert len(marks) == 2
    for place, own in enumerate(marks):
        assert np.array_equal(own, worlds[:, place])


def test_a_method_with_a_long_name_has_room_beside_its_chart():
    name = "./a/folder/with/a/long/name/localizer.py:Localizer"
    records = [one for method in ("mcl", name) for one in trials(method, [1.0, 2.0])]
    chart = charts.points_chart(panel_of(records))
    chart.figure.draw_without_rendering()
    assert chart.figure.axes[0].get_position().width > 0.3


def test_a_label_looks_the_same_in_every_chart_and_others_have_another_look():
    labels = [f"method {n}" for n in range(40)]
    frame = pd.DataFrame({"label": pd.Categorical(labels, categories=labels), "x": 1.0, "y": 2.0})
    looks = [(one.get_color(), one.get_marker()) for one in line(frame, "x", "y").lines]
    assert len(set(looks)) == 40
    part = frame[frame["label"].isin(labels[7:9])]
    assert [(one.get_color(), one.get_marker()) for one in line(part, "x", "y").lines] == looks[7:9]


def test_the_same_chart_gives_the_same_bytes(panel):
    for form in ("svg", "png", "pdf"):
        once, again = (charts.offset_chart(panel).drawn(form) for _ in range(2))
        assert once == again


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
