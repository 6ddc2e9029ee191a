"""basin.csv: how wrong a start may be, by the runs of a displaced prior."""

import math
from dataclasses import replace

from report_cases import changed, finished

from benchmarks.report.runs import starts_table
from benchmarks.trials.scoring import WholeRun

COLUMNS = ["runs", "localized", "metres_median", "steps_median"]


def run_of(world, way, distance, angle, *, name="mcl", off=0.0, segment=6.0, **params):
    """A finished trial with such curves, of a start that is off by so much."""
    place = {"world": {"segment": segment}, "assumed": {"prior.distance": off}, "params": params}
    record = changed(finished(name, world, 1.0, **place), unit="m")
    curves = {"way": way, "distance": distance, "angle": angle}
    return changed(record, journey=WholeRun(scores={}, curves=curves))


def test_a_run_is_localized_from_where_it_stays_near_to_its_end():
    way, near, astray = [0.0, 1.0, 2.0, 3.5], [0.2] * 4, [1.5] * 4
    expected = [  # distance, angle, metres and steps; within half of the segment
        (near, [0.1] * 4, 0.0, 0, 1),
        ([0.2, 1.5, 1.0, 0.2], [0.1] * 4, 2.0, 2, 1),
        (near, [0.1, 0.6, 0.6, 0.5], 3.5, 3, 0),
        (near, [0.1, 0.1, 0.1, 0.6], math.inf, math.inf, 0),
        (astray, [0.1] * 4, math.inf, math.inf, 0),
    ]
    runs = [run_of(w, way, *curves) for w, (*curves, _, _, _) in enumerate(expected)]
    for run, (*_, metres, steps, soon) in zip(runs, expected, strict=True):
        rows = starts_table([run])[COLUMNS].to_numpy().tolist()
        assert rows == [[1, soon, metres, steps]]
    assert starts_table(runs)[COLUMNS].to_numpy().tolist() == [[5, 2, 3.5, 3]]


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
