"""Whether the plan is still about the robot: what is kept of it, and how well signals tell."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from fake_episode import TASK
from report_cases import finished

from benchmarks.report.tables import validity_table
from benchmarks.sweeps.store import _unlike_plan
from benchmarks.tables.csv_files import plans_csv
from benchmarks.tables.panels import panels
from benchmarks.tables.plan_validity import RECENT, validities
from benchmarks.trials.plans import SIGNALS, plan_record, plan_row
from localizers.inference.belief import PlanReading

AHEAD = np.tile([5.0, 0.0], (8, 1))  # 40 px straight on
IN_THE_OPEN, AT_THE_WALL = np.array([30.0, 50.0, 0.0]), np.array([30.0, 50.0, math.pi])


def read(pose, **reading):
    belief = SimpleNamespace(plan_reading=PlanReading(AHEAD, AHEAD, **reading))
    return plan_row(belief, pose, TASK)


def test_a_plan_conflicts_if_it_collides_from_the_true_pose():
    signals = {"tempering": 0.5, "feasible": 0.25, "log_evidence": -2.0, "valid": 0.75}
    kept = [signals[name] for name in SIGNALS]
    assert read(IN_THE_OPEN, **signals) == [0.0, *kept]
    assert read(AT_THE_WALL, **signals) == [1.0, *kept]


def test_nothing_is_kept_of_a_belief_that_reads_no_plan():
    blind = plan_row(SimpleNamespace(), IN_THE_OPEN, TASK)
    assert np.isnan(blind).all()
    assert np.isnan(read(IN_THE_OPEN)).all()  # a plan without a step
    assert plan_record([blind, blind]) == plan_record([]) == {}
    some = plan_record([blind, read(IN_THE_OPEN, tempering=1.0, feasible=1.0)])["plan"]
    assert some["conflict"] == [None, 0.0]


def run(world, conflict, feasible, *, scenario, evidence=None):
    evidence = [-1.0] * len(feasible) if evidence is None else evidence
    columns = {"conflict": conflict, "feasible": feasible, "log_evidence": evidence}
    return finished("mcl-plan", world, 1.0, scenario=scenario) | {"plan": columns}


def test_steps_of_scenarios_are_taken_together_by_world():
    records = [run(w, [0.0, 0.0], [0.9, 0.5], scenario="guided") for w in (0, 1)]
    records += [run(w, [1.0, None], [0.7, 0.1], scenario="guided-stale") for w in (0, 1)]
    records += [finished("mcl-map", 0, 1.0, scenario="guided")]
    (row,) = validities(panels(records))
    found = row.signals["feasible"]
    assert (row.label, found.auroc.mean, found.far_steps, found.far_worlds) == (
        *("mcl-plan", 0.5),
        *(1 / 3, 2),
    )
    assert [panel.setting.scenario for panel in row.panels] == ["guided", "guided-stale"]
    table = validity_table(panels(records))
    assert table.lines[0][:2] == ["guided, guided-stale", "mcl-plan"]
    assert plans_csv([row]).count("\n") == 1 + len(row.signals)


def test_recent_evidence_is_the_mean_of_the_steps_so_far_at_most_twenty():
    steps = RECENT + 10
    evidence = [0.0] * (steps - 2) + [-3.0, None]
    conflict = [0.0] * (steps - 2) + [1.0, 1.0]
    records = [
        run(w, conflict, [0.5] * steps, scenario="guided", evidence=evidence) for w in (0, 1)
    ]
    (row,) = validities(panels(records))
    assert row.signals[f"log_evidence_{RECENT}"].auroc.mean == 1.0
    assert row.signals["log_evidence"].far_steps == 1 / (steps - 1)  # the last one is not known


def test_a_sweep_without_plans_or_without_conflict_has_no_table():
    assert validity_table(panels([finished("mcl", 0, 1.0)])) is None
    assert validity_table(panels([run(0, [0.0], [0.5], scenario="guided")])) is None


@pytest.mark.parametrize(
    ("change", "named"),
    [({"feasible": [0.5]}, "length"), ({"tempering": ["x", 1.0]}, "plan.tempering")],
)
def test_readings_that_are_not_as_they_are_kept_are_named(change, named):
    plan = {name: [0.5, None] for name in ("conflict", *SIGNALS)}
    assert _unlike_plan(plan, 2) is None
    assert _unlike_plan(None, 2) is None
    assert named in _unlike_plan(plan | change, 2)
