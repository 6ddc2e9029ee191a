"""Whether the plan is still about the robot: what is kept of it, and how well signals tell."""

import math
from types import SimpleNamespace

import numpy as np
from fake_episode import TASK
from report_cases import changed, finished

from benchmarks.tables.panels import panels
from benchmarks.tables.signals import plans_table
from benchmarks.trials.scoring import ErrorCurve
from benchmarks.trials.trace import PLAN_COLUMNS, plan_columns, plan_row
from localizers.inference.belief import PlanReading

AHEAD = np.tile([5.0, 0.0], (8, 1))  # 40 px straight on
IN_THE_OPEN, AT_THE_WALL = np.array([30.0, 50.0, 0.0]), np.array([30.0, 50.0, math.pi])


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


def run(world, conflict, feasible, *, scenario, evidence=None):
    steps = len(feasible)
    columns = dict.fromkeys(PLAN_COLUMNS, [1.0] * steps)
    columns |= {"conflict": conflict, "feasible": feasible}
    columns["log_evidence"] = [-1.0] * steps if evidence is None else evidence
    return planned(finished("mcl-plan", world, 1.0, scenario=scenario), columns)


def planned(record, columns):
    """The same trial with these readings of plans at as many steps."""
    steps = len(columns["feasible"])
    return changed(record, plan=columns, steps_done=steps, curves={0: ErrorCurve(0, [1.0])})


def signals(records):
    """Rows of plans.csv by signal."""
    return plans_table(panels(records)).set_index("signal")


def test_steps_of_scenarios_are_taken_together_by_world():
    records = [run(w, [0.0, 0.0], [0.9, 0.5], scenario="guided") for w in (0, 1)]
    records += [run(w, [1.0, None], [0.7, 0.1], scenario="guided-stale") for w in (0, 1)]
    records += [finished("mcl-map", 0, 1.0, scenario="guided")]
    row = signals(records).loc["feasible"]
    assert (row.label, row.auroc, row.conflict_steps) == ("mcl-plan", 0.5, 1 / 3)
    assert (row.conflict_worlds, row.scenarios) == (2, "guided guided-stale")


def test_the_trust_of_a_lap_is_its_least_and_is_told_of_hedges_only():
    def lap(world, conflict, trusted, scenario):
        record = run(world, conflict, [0.5] * len(conflict), scenario=scenario)
        return planned(record, record.plan | {"trusted": trusted})

    right = [lap(w, [0.0, 0.0, 0.0], [0.4, 0.4, 0.4], "guided") for w in (0, 1)]
    wrong = [lap(w, [1.0, 0.0, 0.0], [0.9, 0.3, None], "guided-stale") for w in (0, 1)]
    found = signals(right + wrong)["auroc"]
    assert (found["trusted_lap"], found["trusted"]) == (1.0, 0.0)
    blind = [lap(w, [0.0, 1.0], [None, None], "guided") for w in (0, 1)]
    assert not {"trusted", "trusted_lap"} & set(signals(blind).index)
