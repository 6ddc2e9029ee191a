"""The optimality gap: what is held against the limit, and over which worlds."""

import math
from dataclasses import replace

import numpy as np
import pytest
from refusals import refused
from report_cases import changed, finished, parsed, results, trials

from benchmarks.setup.overrides import Overrides
from benchmarks.sweeps.design import Limit, Sweep
from benchmarks.sweeps.results import limits_apart
from benchmarks.sweeps.sweepfile import sweep_of
from benchmarks.tables.comparison import LimitRuns
from benchmarks.tables.frames import csv_of
from benchmarks.tables.stats import paired_bootstrap
from benchmarks.trials.spec import Method

MANY = {"particles": 100_000}


def limit_run(world, error, *, seed=0, **setting):
    return finished("mcl-pilots", world, error, filter_seed=seed, params=MANY, **setting)


def gaps(records, *limits):
    runs = [limit if isinstance(limit, LimitRuns) else LimitRuns((), limit) for limit in limits]
    return [*results(records, limits=runs).gaps.itertuples()]


def test_each_method_is_held_against_the_limit_of_its_own_target():
    unnamed = LimitRuns((), [limit_run(w, 10.0) for w in range(3)])
    runs = [finished("mcl-plan", w, 4.0, params=MANY) for w in (0, 1)]
    own = LimitRuns(("mcl-plan", "mcl"), runs)
    records = [r for name in ("mcl", "deq-mcl", "mcl-plan") for r in trials(name, [12.0] * 3)]
    for order in ((unnamed, own), (own, unnamed)):
        found = {(r.method, r.params): (r.limit, r.gap, r.worlds) for r in gaps(records, *order)}
        assert found == {
            ("mcl-pilots", '{"particles":100000}'): ("mcl-pilots", 0.0, 3),
            ("deq-mcl", "{}"): ("mcl-pilots", 2.0, 3),
            ("mcl-plan", '{"particles":100000}'): ("mcl-plan", 0.0, 2),
            ("mcl", "{}"): ("mcl-plan", 8.0, 2),
            ("mcl-plan", "{}"): ("mcl-plan", 8.0, 2),
        }
    assert {row.method for row in gaps(records, own)} == {"mcl", "mcl-plan"}


def test_the_gap_is_taken_over_shared_worlds_only_and_runs_are_averaged_before():
    limits = [limit_run(w, 10.0 * w + s, seed=s) for w in (0, 1, 2) for s in (0, 1)]
    records = [finished("mcl", w, 10.0 * w + 4.0 + w) for w in (1, 2, 3, 4)]
    _, row = gaps(records, limits)
    differences = np.array([15.0 - 10.5, 26.0 - 20.5])
    assert (row.method, row.worlds) == ("mcl", 2)
    assert row.error == (15.0 + 26.0) / 2
    assert row.gap == pytest.approx(differences.mean())
    assert (row.gap_low, row.gap_high) == pytest.approx(paired_bootstrap(differences))


def test_the_spread_between_runs_is_that_on_the_same_world():
    limits = [limit_run(w, 100.0 * w + e, seed=s) for w in (0, 1) for s, e in enumerate((1, 3))]
    row, alone = gaps(trials("mcl", [1.0, 1.0]), limits)
    assert row.seed_sd == pytest.approx(math.sqrt(2))  # of 1 and 3; worlds lie 100 apart
    assert math.isnan(alone.seed_sd)


def test_a_setting_or_an_offset_without_a_limit_has_no_gap():
    limits = [limit_run(0, 1.0, offsets=(0, -20))]
    records = [finished("deq-mcl", 0, 2.0, offsets=(0, -20, 20))]
    records += [finished("deq-mcl", 0, 2.0, scenario="sharp"), finished("mcl", 7, 2.0)]
    found = [(row.method, row.offset) for row in gaps(records, limits)]
    assert found == [("mcl-pilots", 0), ("mcl-pilots", -20), ("deq-mcl", 0), ("deq-mcl", -20)]


def test_gaps_csv_holds_a_method_without_the_swept_parameter_against_each_panels_limit():
    records = [finished("mcl-map", 0, 5.0, params={"beta": b}) for b in (1, 10)]
    records += [finished("ekf", 0, 4.0)]
    limits = [finished("mcl-pilots", 0, e, params={"beta": b}) for b, e in ((1, 3.0), (10, 2.0))]
    named = ("swept", "method", "limit_params", "gap")
    text = csv_of(results(records, limits=[LimitRuns((), limits)]).gaps)
    lines = [[line[name] for name in named] for line in parsed(text)]
    differences = {1: ("0.0", "2.0", "1.0"), 10: ("0.0", "3.0", "2.0")}
    assert lines == [
        [f'{{"beta":{b}}}', name, f'{{"beta":{b}}}', difference]
        for b in differences
        for name, difference in zip(("mcl-pilots", "mcl-map", "ekf"), differences[b], strict=True)
    ]


SWEEP = Sweep(
    title="t",
    localizers=(Method(name="mcl"), Method(name="dead-reckoning")),
    trials=5,
    filter_seeds=3,
    params=Overrides({"particles": 10}),
    limits=(Limit(method=Method(name="mcl", params=Overrides(MANY)), trials=2, filter_seeds=4),),
)


def ran(sweep):
    return [changed(finished("x", 0, 1.0), trial=trial) for trial in sweep.distinct()]


def test_the_limit_runs_on_the_first_worlds_and_is_not_compared():
    assert SWEEP.combinations == 2 * 5 * 3 + 2 * 4 == len(SWEEP.distinct()) == SWEEP.planned
    limits = list(SWEEP.limiting(*SWEEP.limits))
    assert {(t.trial, t.filter_seed) for t in limits} == {(w, s) for w in (0, 1) for s in range(4)}
    assert {t.params for t in limits} == {Overrides(MANY)}
    apart = limits_apart(SWEEP, results(ran(SWEEP)))
    (limit,) = apart.limits
    assert [len(apart.records), len(limit.records), len(apart.finished)] == [30, 8, 38]


def test_an_axis_over_what_the_limit_fixes_runs_it_once():
    varied = {"vary": [{"params.particles": [10, 20, 30]}]}
    sweep = sweep_of(SWEEP.canonical() | varied, title="varied")
    assert len({t.params for t in sweep.limiting(*sweep.limits)}) == 1
    assert sweep.combinations - len(sweep.distinct()) == 2 * 8 + 2 * 15  # and dead reckoning
    assert sweep.planned == len(sweep.distinct())


def test_what_is_written_of_a_limit_is_read_again():
    assert sweep_of(SWEEP.canonical(), title="") == SWEEP
    further = Limit(method=Method(name="mcl-map"), of=("mcl-map", "mcl-map-smoother"), trials=1)
    several = replace(SWEEP, limits=(*SWEEP.limits, further))
    assert sweep_of(several.canonical(), title="") == several
    one = {"name": "mcl", "params": MANY, "trials": 2, "filter_seeds": 4}  # [limit], not [[limit]]
    assert sweep_of(SWEEP.canonical() | {"limit": one}, title="") == SWEEP


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"limit": {"name": "mcl", "filter_seeds": 0}}, ["filter_seeds of the limit", "0"]),
        (
            {"limit": [{"name": "mcl", "of": ["mcl"]}, {"name": "mcl-map", "of": ["mcl"]}]},
            ["'mcl'", "2 limits"],
        ),
        ({"baseline": "mcl-map"}, ["baseline", "'mcl-map'", "dead-reckoning"]),
    ],
)
def test_a_limit_or_a_baseline_that_cannot_be_is_refused(changes, named):
    with refused(*named):
        sweep_of(SWEEP.canonical() | changes, title="t")
