"""How well signals tell: the quality, and trust in a plan."""

import math
from functools import cache
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from fake_episode import TASK
from report_cases import changed, finished, lines_of, panel_of, trials

from benchmarks.report.tables import detection_table
from benchmarks.setup.scenario import Thresholds
from benchmarks.tables.panels import panels
from benchmarks.tables.signals import detection, plans_table
from benchmarks.trials.scoring import ErrorCurve
from benchmarks.trials.trace import PLAN_COLUMNS, plan_columns, plan_row
from localizers.inference.belief import PlanReading

NEAR, AWAY = 1.0, 60.0  # errors on either side of 50 px
KINDS = {"rated": (AWAY, NEAR), "never": (NEAR, NEAR), "always": (AWAY, AWAY)}
AHEAD = np.tile([5.0, 0.0], (8, 1))  # 40 px straight on
IN_THE_OPEN, AT_THE_WALL = np.array([30.0, 50.0, 0.0]), np.array([30.0, 50.0, math.pi])


def trial(number, steps, *, first_state=0, at_start=NEAR, filter_seed=0):
    return rated(finished("x", number, 20.0, filter_seed=filter_seed), steps, first_state, at_start)


def rated(record, steps, first_state=0, at_start=NEAR):
    errors = [at_start, *(error for _, error in steps)][first_state:]
    curves, quality = {0: ErrorCurve(first_state, errors)}, [quality for quality, _ in steps]
    return changed(record, curves=curves, quality=quality, steps_done=len(steps))


def random_trials(worlds, *, seed=0, steps=30, seeds=1):
    """Steps whose quality falls with the error, of 8 values, so that many are equal."""
    rng = np.random.default_rng(seed)
    made = []
    for number, filter_seed in product(range(worlds), range(seeds)):
        errors = rng.uniform(0, 100, steps)
        quality = np.round(np.clip(0.5 - (errors - 50) / 200 + rng.normal(0, 0.3, steps), 0, 1) * 7)
        steps_of = list(zip((quality / 7).tolist(), errors.tolist(), strict=True))
        made.append(trial(number, steps_of, filter_seed=filter_seed))
    return made


def counted(records):
    """AUROC by looking at every pair; None without one."""
    rated = [pair for r in records for pair in zip(r.quality, r.curves[0].error[1:], strict=True)]
    far = [q for q, e in rated if e > 50]
    others = [q for q, e in rated if e <= 50]
    wins = sum((a < b) + 0.5 * (a == b) for a in far for b in others)
    return wins / (len(far) * len(others)) if far and others else None


@pytest.mark.parametrize("seed", range(5))
def test_auroc_is_the_share_of_pairs_in_order_with_ties_counted_half(seed):
    records = random_trials(4, seed=seed, seeds=2)
    found = detection(records)
    assert found["auroc"] == pytest.approx(counted(records), rel=1e-15)  # of counts
    assert found["far_worlds"] == 4
    assert detection(records[::-1]) == found


def test_the_interval_is_that_of_resampling_whole_worlds_one_after_the_other():
    # a resample without a far step is left out: two of the five worlds have none
    records = random_trials(3, steps=6, seeds=2)
    records += [trial(w, [(0.4, NEAR), (0.9, NEAR)]) for w in (3, 4)]

    @cache
    def resampled(worlds):
        return counted([r for w in worlds for r in records if r.trial.trial == w])

    rng = np.random.default_rng(0)
    drawn = (tuple(sorted(rng.integers(5, size=5).tolist())) for _ in range(10_000))
    values = [area for worlds in drawn if (area := resampled(worlds)) is not None]
    assert 0 < 10_000 - len(values) < 200  # (2/5)⁵ = 1 %
    mean, low, high = (detection(records)[f"auroc{end}"] for end in ("", "_low", "_high"))
    assert (low, high) == pytest.approx(tuple(np.quantile(values, [0.025, 0.975])), rel=1e-12)
    assert low < mean < high


def test_far_is_above_the_threshold_of_the_record_and_not_at_it():
    one = trial(0, [(0.6, 50.0), (0.5, 50.1)])
    metres = changed(trial(0, [(0.6, 1.0), (0.5, 1.1)]), thresholds=Thresholds(far=1.0), unit="m")
    for found in (detection([one]), detection([metres])):
        assert (found["auroc"], found["far_steps"]) == (1.0, 0.5)


@pytest.mark.parametrize(
    ("at", "auroc", "share"),
    [
        ({"at_start": AWAY}, 1.0, 1 / 2),  # the start is not scored
        ({"first_state": 2}, math.nan, 0.0),  # x_1 was not estimated
    ],
)
def test_steps_with_a_quality_are_matched_with_their_own_states(at, auroc, share):
    found = detection([trial(0, [(0.1, AWAY), (None, AWAY), (0.3, NEAR)], **at)])
    assert found["auroc"] == pytest.approx(auroc, nan_ok=True)
    assert found["far_steps"] == share


def test_the_table_says_the_auroc_and_of_how_many_steps():
    far = [20.0] * 3
    steps = {name: [*zip((0.2, 0.9), errors, strict=True)] for name, errors in KINDS.items()}
    records = [rated(run, steps[name]) for name in KINDS for run in trials(name, far)]
    panel = panel_of(records + trials("blind", far))
    table = detection_table(panel)
    assert list(table.frame)[2] == "steps with e > 50 px"
    assert lines_of(table) == [
        ["rated", "1.00 (1.00 to 1.00)", "50.0 %", "3 of 3"],
        ["never", "n/a", "0.0 %", "0 of 3"],
        ["always", "n/a", "100.0 %", "3 of 3"],
        ["blind", "n/a", "n/a", "n/a"],
    ]


def read(pose, trusted=math.nan, **reading):
    belief = SimpleNamespace(trusted=trusted, plan_reading=PlanReading(AHEAD, AHEAD, **reading))
    return plan_row(belief, pose, TASK)


def test_a_plan_conflicts_if_it_collides_from_the_true_pose():
    signals = {"tempering": 0.5, "feasible": 0.25, "log_evidence": -2.0, "trusted": 0.75}
    kept = [signals[name] for name in PLAN_COLUMNS[1:]]
    assert read(IN_THE_OPEN, **signals) == [0.0, *kept]
    assert read(AT_THE_WALL, **signals) == [1.0, *kept]


def test_nothing_is_kept_of_a_belief_that_reads_no_plan():
    blind = plan_row(SimpleNamespace(), IN_THE_OPEN, TASK)
    assert np.isnan(blind).all()
    assert np.isnan(read(IN_THE_OPEN)).all()  # a plan without a step
    assert plan_columns([blind, blind]) is plan_columns([]) is None
    some = plan_columns([blind, read(IN_THE_OPEN, tempering=1.0, feasible=1.0)])
    assert some["conflict"] == [None, 0.0]


def planned_run(world, conflict, feasible, *, scenario, evidence=None):
    steps = len(feasible)
    columns = dict.fromkeys(PLAN_COLUMNS, [1.0] * steps)
    columns |= {"conflict": conflict, "feasible": feasible}
    columns["log_evidence"] = [-1.0] * steps if evidence is None else evidence
    return planned(finished("mcl-plan", world, 1.0, scenario=scenario), columns)


def planned(record, columns):
    steps = len(columns["feasible"])
    return changed(record, plan=columns, steps_done=steps, curves={0: ErrorCurve(0, [1.0])})


def signals(records):
    return plans_table(panels(records)).set_index("signal")


def test_steps_of_scenarios_are_taken_together_by_world():
    records = [planned_run(w, [0.0, 0.0], [0.9, 0.5], scenario="guided") for w in (0, 1)]
    records += [planned_run(w, [1.0, None], [0.7, 0.1], scenario="guided-stale") for w in (0, 1)]
    records += [finished("mcl-map", 0, 1.0, scenario="guided")]
    row = signals(records).loc["feasible"]
    assert (row.label, row.auroc, row.conflict_steps) == ("mcl-plan", 0.5, 1 / 3)
    assert (row.conflict_worlds, row.scenarios) == (2, "guided guided-stale")


def test_the_trust_of_a_lap_is_its_least_and_is_told_of_hedges_only():
    def lap(world, conflict, trusted, scenario):
        record = planned_run(world, conflict, [0.5] * len(conflict), scenario=scenario)
        return planned(record, record.plan | {"trusted": trusted})

    right = [lap(w, [0.0, 0.0, 0.0], [0.4, 0.4, 0.4], "guided") for w in (0, 1)]
    wrong = [lap(w, [1.0, 0.0, 0.0], [0.9, 0.3, None], "guided-stale") for w in (0, 1)]
    found = signals(right + wrong)["auroc"]
    assert (found["trusted_lap"], found["trusted"]) == (1.0, 0.0)
    blind = [lap(w, [0.0, 1.0], [None, None], "guided") for w in (0, 1)]
    assert not {"trusted", "trusted_lap"} & set(signals(blind).index)
