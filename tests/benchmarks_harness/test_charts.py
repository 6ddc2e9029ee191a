"""The charts of a panel: what is drawn can be seen, and is what it is said to be."""

from functools import partial

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from report_cases import THREE, changed, finished, trials

from benchmarks.pictures import styled
from benchmarks.report import charts, curves
from benchmarks.report.svg import HOUSE_STYLE, canvas, looks, picture
from benchmarks.tables.pairing import profile
from benchmarks.tables.panels import panels


def axes_of(module, draw):
    """The axes of each picture that ``draw`` makes of a module, by name."""
    found = {}

    def keep(figure, *, name, **_):
        (found[name],) = figure.axes

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "picture", keep)
        draw()
    return found


@settings(deadline=None, max_examples=15, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.floats(0, 1), min_size=2, max_size=40), st.sampled_from([0.0, 1e-3, 1.0, 1e6]))
def test_every_mark_and_bar_of_every_chart_is_inside_its_axes(shares, size):
    errors = [size * (1 + share) for share in shares]
    records = [one for name, (_, k) in THREE.items() for one in trials(name, errors, offsets=k)]
    for record in records:
        share = shares[record.trial.trial]
        for score in record.scores:
            score |= {"coverage_50": share, "coverage_80": share**2, "coverage_95": 1 - share}
    (panel,) = panels(records)
    look = looks(panel.labels.values())

    def draw():
        for name in ("points", "offset", "speed", "calibration"):
            getattr(charts, f"{name}_chart")(panel, look)

    found = axes_of(charts, draw)
    assert [*found] == ["points-1", "offsets-1", "speed-1", "calibration-1"]
    for name, axes in found.items():
        (left, right), ends = axes.get_xlim(), sorted(axes.get_ylim())
        marked = [line for line in axes.lines if line.get_marker() not in ("None", "")]
        places = [place for line in marked for place in line.get_xydata().tolist()]
        bars = [way for bar in axes.collections for way in bar.get_segments()]
        places += np.concatenate([np.empty((0, 2)), *bars]).tolist()
        assert places, name
        assert all(left <= x <= right and ends[0] <= y <= ends[1] for x, y in places), name


def test_a_method_with_a_long_name_has_room_beside_its_chart():
    name = "./a/folder/with/a/long/name/localizer.py:Localizer"
    records = [one for method in ("mcl", name) for one in trials(method, [1.0, 2.0])]
    (panel,) = panels(records)
    (axes,) = charts.points_chart(panel, looks(panel.labels.values())).figure.axes
    assert axes.get_position().width > 0.3


def test_each_chart_over_time_dashes_the_methods_own_baseline():
    one, other = ({"params": {"resampler": kind}} for kind in ("systematic", "multinomial"))
    records = trials("mcl", [10.0], **one) + trials("mcl", [20.0], **other)
    (panel,) = panels(records + trials("deq-mcl", [15.0], **other))
    found = axes_of(charts, lambda: charts.time_charts(panel, looks(panel.labels.values())))
    assert [*panel.labels.values()][2] == "deq-mcl"
    assert [[*line.get_ydata()[:1]] for axes in found.values() for line in axes.lines
            if line.get_linestyle() == "--"] == [[20.0]]  # fmt: skip
    assert any(line.get_linestyle() == "--" for line in [*found.values()][2].lines)


def estimates_in(axes):
    """What is drawn under each label: places, means, and the ends of their bars."""
    drawn = {}
    for container in axes.containers:
        marks, _, bars = container
        ends = [segment[:, 1].tolist() for bar in bars for segment in bar.get_segments()]
        drawn[container.get_label()] = (*marks.get_xydata().T.tolist(), ends)
    return drawn


def told(places, values):
    """The same of estimates."""
    ends = [[pytest.approx(value.low), pytest.approx(value.high)] for value in values]
    return list(places), [value.mean for value in values], ends


@pytest.fixture(scope="module")
def panel():
    """Three methods on five worlds: of other errors, past errors, coverage, profiles and times."""
    records = []
    for place, (name, (_, offsets)) in enumerate(THREE.items()):
        for world in range(5):
            error = {k: 2.0 + place + world**2 + abs(k) / 10 + (k > 0) for k in offsets}
            scores = {f"coverage_{at}": (at + world - place) / 100 for at in (50, 80, 95)}
            one = finished(name, world, error, scores=scores)
            records.append(changed(one, seconds=0.06 * (1 + place) * (1 + world**2)))
    (made,) = panels(records)
    return made


def test_charts_of_a_panel_draw_its_numbers(panel):
    look, rows = looks(panel.labels.values()), panel.present
    for name in ("points", "offset", "speed", "calibration"):
        chart = getattr(charts, f"{name}_chart")
        (axes,) = axes_of(charts, lambda chart=chart: chart(panel, look)).values()
        drawn = estimates_in(axes)
        for place, row in enumerate(rows):
            label = panel.labels[row.method]
            if name == "points":
                lines = [line.get_xydata().tolist() for line in axes.lines]
                assert [[end, place - 0.3] for end in row.error[1:]] in lines
                assert sorted(zip(*lines_of_marks(axes, place), strict=True)) == sorted(
                    (error, place) for error in row.errors.values()
                )
            elif name == "offset":
                held = profile(panel.records[row.method])
                assert drawn[label] == told(held, held.values())
            elif name == "speed":  # 60 steps: the third of five times is the median
                milliseconds = pytest.approx(1.0 * (1 + place) * 5)
                assert drawn[label] == told([milliseconds], [row.error])
            else:
                shares = [row.scores[f"coverage_{at}"].percent for at in (50, 80, 95)]
                aside = drawn[label][0][0] - 50
                assert drawn[label] == told([50 + aside, 80 + aside, 95 + aside], shares)
                (line,) = [line for line in axes.lines if line.get_label() == "calibrated"]
                assert line.get_xydata().tolist() == [[0, 0], [100, 100]]


def lines_of_marks(axes, place):
    """Errors and rows of the marks of a method."""
    marks = [line for line in axes.lines if line.get_markeredgewidth() == 0]
    return marks[place].get_xdata().tolist(), np.rint(marks[place].get_ydata()).tolist()


def test_every_mark_of_many_worlds_is_where_the_line_of_its_world_is():
    rng = np.random.default_rng(0)
    records = [finished(n, w, rng.uniform(1, 9)) for n in ("mcl", "deq-mcl") for w in range(40)]
    (panel,) = panels(records)
    found = axes_of(charts, lambda: charts.points_chart(panel, looks(panel.labels.values())))
    lines = [line.get_xydata() for line in found["points-1"].lines]
    worlds, rows = np.array(lines[:40]), [drawn for drawn in lines[40:] if len(drawn) == 40]
    assert len(rows) == 2
    for place, row in enumerate(rows):
        assert np.array_equal(row, worlds[:, place])


def test_charts_over_time_draw_mean_middle_80_percent_and_past_on_one_scale(panel):
    found = axes_of(charts, lambda: charts.time_charts(panel, looks(panel.labels.values())))
    assert len({axes.get_ylim() for axes in found.values()}) == 1
    for axes, row in zip(found.values(), panel.present, strict=True):
        errors = list(row.errors.values())
        low, high = np.quantile(errors, [0.1, 0.9])
        (band,) = axes.collections
        heights = band.get_paths()[0].vertices[:, 1]
        assert (heights.min(), heights.max()) == pytest.approx((low, high))
        assert axes.get_ylim()[1] > high
        styles = {line.get_linestyle(): line for line in axes.lines}
        assert set(styles["-"].get_ydata()) == {np.mean(errors)}
        past = [r for r in panel.rows if r.method == row.method and r.offset == -20]
        assert (":" in styles) == bool(past)
        if past:
            assert set(styles[":"].get_ydata()) == {past[0].error.mean}


@pytest.mark.parametrize(("values", "scale"), [((10, 80), "log"), ((10, 70), "linear")])
def test_curves_draw_the_rows_of_each_panel_over_the_value_that_was_swept(values, scale):
    records = trials("dead-reckoning", [400.0, 400.0])
    for n in values:
        for name, error in (("mcl", 5.0), ("deq-mcl", 30.0 / n)):
            records += trials(name, [error, error + 1], params={"particles": n})
    found = panels(records)
    look = looks(label for one in found for label in one.labels.values())
    for quantity, labels in (
        (curves.ERROR, ["dead-reckoning", "deq-mcl", "mcl"]),
        (curves.DIFFERENCE, ["deq-mcl"]),
    ):
        draw = partial(curves.swept_charts, found, look, quantity)
        (axes,) = axes_of(curves, draw).values()
        drawn = estimates_in(axes)
        assert sorted(drawn) == labels
        for label in labels:
            rows = [row for one in found for row in one.present if row.method.name == label]
            assert drawn[label] == told(values, [quantity.of(row) for row in rows])
        assert axes.get_xscale() == scale
        zero = [line for line in axes.lines if set(line.get_ydata()) == {0}]
        assert zero
        assert (axes.get_ylim()[0] == 0) == (quantity is curves.ERROR)


@pytest.mark.parametrize("names", [1, 2, 3, 4, 5, 7])
@pytest.mark.parametrize("letters", [4, 15, 22, 40, 50, 120])
def test_every_name_of_a_legend_is_inside_the_picture_and_below_the_axes(names, letters):
    labels = [f"{number} {'plan_beta=0.1 ' * 9}"[:letters] for number in range(names)]
    labels[-1] = "mcl"
    with styled(HOUSE_STYLE):
        figure, axes = canvas(4.8, 2.9, legend_of=labels)
        for label in labels:
            axes.plot([0, 1], label=label)
        axes.set_xlabel("driven, m")
        picture(figure, name="", title="", caption="", alt="")
        figure.draw_without_rendering()
        (legend,) = figure.legends
        shown, below = legend.get_window_extent(), axes.xaxis.get_tightbbox()
    named = [text.get_text().replace("\n", " ") for text in legend.get_texts()]
    assert named == [label.strip() for label in labels]
    assert 0 <= shown.x0 < shown.x1 <= figure.bbox.width
    assert 0 <= shown.y0 < shown.y1 <= below.y0
