"""basin.csv: how wrong a start may be, by the runs of a displaced prior."""

import math
from dataclasses import replace
from statistics import median_high

import numpy as np
from report_cases import changed, finished

from benchmarks.tables.starts import starts_table
from benchmarks.trials.collecting import WholeRun


def run_of(world, way, distance, angle, *, name="mcl", off=0.0, segment=6.0, **params):
    """A finished trial with such curves, of a start that is off by so much."""
    place = {"world": {"segment": segment}, "assumed": {"prior.distance": off}, "params": params}
    record = changed(finished(name, world, 1.0, **place), unit="m")
    curves = {"way": way, "distance": distance, "angle": angle}
    return changed(record, journey=WholeRun(scores={}, curves=curves))


def test_a_run_is_localized_from_where_it_stays_near_to_its_end():
    rng = np.random.default_rng(0)
    runs, expected = [], []
    for world in range(200):
        n = int(rng.integers(1, 12))
        off = np.where(rng.random(n) < 0.3, 1.5, 0.2).tolist()
        turned = np.where(rng.random(n) < 0.2, 0.6, 0.1).tolist()
        way = np.cumsum(rng.random(n)).tolist()
        runs.append(run_of(world, way, off, turned))
        near = [d <= 1 and a <= math.radians(30) for d, a in zip(off, turned, strict=True)]
        never = math.inf, math.inf
        expected.append(next(((way[i], i) for i in range(n) if all(near[i:])), never))
        one = starts_table(runs[-1:]).iloc[0]
        assert (one["metres_median"], one["steps_median"]) == expected[-1]
        assert one["localized"] == (expected[-1][0] <= 3)  # half of the segment
    (row,) = starts_table(runs).to_dict("records")
    ways, steps = zip(*expected, strict=True)
    assert (row["runs"], row["localized"]) == (200, sum(way <= 3 for way in ways))
    assert (row["metres_median"], row["steps_median"]) == (median_high(ways), median_high(steps))
    assert len(set(expected)) > 20
    assert never in expected


def test_ten_metres_are_soon_enough_however_long_a_run_is():
    for way, soon in ((9.9, 1), (10.1, 0)):
        run = run_of(0, [0.0, way], [3.0, 0.0], [0.0, 0.0], segment=50.0)
        assert starts_table([run])["localized"].tolist() == [soon]


def test_a_failed_run_is_never_localized_and_other_priors_have_no_row():
    run = run_of(0, [0.0], [0.0], [0.0])
    failed = replace(run.trial, trial=1)
    row = starts_table([run], [failed]).iloc[0]
    assert (row["runs"], row["localized"], row["metres_median"]) == (2, 1, math.inf)
    assert starts_table([finished("mcl", 0, 1.0)]).empty


def test_rows_are_by_localizer_and_error_and_name_what_else_was_swept():
    places = [("mcl", 1.0, 300), ("amcl", 0.0, 100), ("mcl", 0.0, 300), ("mcl", 1.0, 100)]
    runs = [
        run_of(0, [0.0], [0.0], [0.0], name=name, off=off, particles=count)
        for name, off, count in places
    ]
    rows = starts_table(runs)[["localizer", "distance_m"]].to_numpy().tolist()
    assert rows == [
        ["mcl particles 300", 0.0],
        ["mcl particles 300", 1.0],
        ["amcl", 0.0],
        ["mcl particles 100", 1.0],
    ]
