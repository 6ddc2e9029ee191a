"""The charts of a panel: what is drawn can be seen, and is what it is said to be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from report_cases import THREE, trials

from benchmarks.report import charts
from benchmarks.report.style import looks
from benchmarks.tables.panels import panels


@settings(deadline=None, max_examples=15)
@given(
    st.lists(st.floats(0, 1), min_size=2, max_size=40),
    st.sampled_from([0.0, 1e-3, 1.0, 1e6]),
)
def test_every_mark_and_bar_of_every_chart_is_inside_its_axes(shares, size):
    errors = [size * (1 + share) for share in shares]
    records = [one for name, (_, k) in THREE.items() for one in trials(name, errors, offsets=k)]
    for record in records:
        share = shares[record["trial"]["trial"]]
        for score in record["scores"]:
            score |= {"coverage_50": share, "coverage_80": share**2, "coverage_95": 1 - share}
    (panel,) = panels(records)
    seen = []

    def keep(figure, *, name, **_):
        (axes,) = figure.axes
        (left, right), ends = axes.get_xlim(), sorted(axes.get_ylim())
        marked = [line for line in axes.lines if line.get_marker() not in ("None", "")]
        places = [place for line in marked for place in line.get_xydata().tolist()]
        bars = [way for bar in axes.collections for way in bar.get_segments()]
        places += np.concatenate([np.empty((0, 2)), *bars]).tolist()
        assert places, name
        assert all(left <= x <= right and ends[0] <= y <= ends[1] for x, y in places), name
        seen.append(name)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(charts, "picture", keep)
        for name in ("points", "offset", "speed", "calibration"):
            getattr(charts, f"{name}_chart")(panel, looks(panel.labels.values()))
    assert seen == ["points-1", "offsets-1", "speed-1", "calibration-1"]


def test_each_chart_over_time_dashes_the_methods_own_baseline(monkeypatch):
    one, other = ({"params": {"resampler": kind}} for kind in ("systematic", "multinomial"))
    records = trials("mcl", [10.0], **one) + trials("mcl", [20.0], **other)
    (panel,) = panels(records + trials("deq-mcl", [15.0], **other))
    dashed = {}

    def keep(figure, *, title, **_):
        lines = [line for line in figure.axes[0].lines if line.get_linestyle() == "--"]
        dashed[title.rpartition(": ")[2]] = [float(line.get_ydata()[0]) for line in lines]

    monkeypatch.setattr(charts, "picture", keep)
    charts.time_charts(panel, looks(panel.labels.values()))
    assert dashed == {
        "mcl resampler=systematic": [],
        "mcl resampler=multinomial": [],
        "deq-mcl": [20.0],
    }
