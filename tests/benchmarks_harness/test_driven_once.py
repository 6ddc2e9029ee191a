"""An episode that no belief has a part in is driven once for all methods that follow on it."""

from dataclasses import replace

import numpy as np
import pytest
from deqmcl_command import lose, records

import localizers
from benchmarks.agents import AGENTS
from benchmarks.execution.engines import Where
from benchmarks.setup.names import make_agent
from benchmarks.setup.overrides import Named, Overrides
from benchmarks.sweeps.running import Options, run_missing
from benchmarks.sweeps.store import writing
from benchmarks.sweeps.sweepfile import paper_sweep
from benchmarks.trials.episode import sees_belief
from benchmarks.trials.scoring import record as recorded
from benchmarks.trials.stage import Stage, _driven, attempt, key_of, provenance_of

METHODS = ["mcl", "deq-mcl", "mcl-map"]
DISTURBED = (
    Overrides({"kind": "dropout", "probability": 0.3}),
    Overrides({"kind": "kidnap", "step": 9}),
)
WORLDS = {
    "paper": {},
    "the start is drawn, and told wrong": {
        "scenario": "sharp",
        "assumed": {"prior.kind": "displaced"},
    },
    "the agent shows another plan": {"scenario": "guided-stale"},
    "disturbed": {"disturbance": DISTURBED},
    "an office": {"scenario": "kidnapped"},
    "a wrong map": {"scenario": "wrong-map"},
}


def trials(names=METHODS, **setting):
    """Trials of these methods on one world."""
    assumed = Overrides(setting.pop("assumed", {}))
    made = paper_sweep(localizers=names, trials=1, lag=4, particles=30, **setting).distinct()
    return [replace(trial, assumed=assumed) for trial in made]


@pytest.fixture
def drives(monkeypatch):
    """The trials whose agent drove, from an empty memory on."""
    found, drive = [], Stage.driven
    monkeypatch.setattr(Stage, "driven", lambda stage: found.append(stage.trial) or drive(stage))
    _driven.cache_clear()
    return found


@pytest.mark.parametrize("world", WORLDS)
def test_methods_see_the_very_arrays_and_have_the_records_of_each_alone(world, drives, monkeypatch):
    seen, moments = {}, Stage.moments

    def noted(stage, *how):
        for moment in moments(stage, *how):
            seen.setdefault(stage.trial.localizer, []).append(moment)
            yield moment

    monkeypatch.setattr(Stage, "moments", noted)
    asked = trials(**WORLDS[world])
    after_others = [attempt(trial, key_of(trial)).record for trial in asked]
    assert len(drives) == 1
    first, *others = (seen[trial.localizer] for trial in asked)
    for other in others:
        for a, b in zip(first, other, strict=True):
            assert a.truth is b.truth
            assert a.ranges is b.ranges
            assert a.plan is b.plan
            assert a.action is b.action
    for trial, record in zip(asked, after_others, strict=True):
        _driven.cache_clear()
        alone = attempt(trial, key_of(trial)).record
        assert alone == record
        stage = Stage.of(trial)
        live = stage.trace()  # the robot drives while the localizer follows
        assert recorded(live) == record


def test_another_world_seed_agent_or_disturbance_is_driven_anew(drives):
    (trial,) = trials(["mcl"])
    others = [
        trial,
        replace(trial, trial=1),
        replace(trial, seed=7),
        replace(trial, agent=Named("stale")),
        replace(trial, disturbance=DISTURBED[:1]),
        replace(trial, world=Overrides({"lidar.sigma": 50.0})),
    ]
    for other in others:
        attempt(other, key_of(other))
    assert drives == [other.episode for other in others]


def test_an_agent_that_looks_at_the_belief_is_driven_anew(drives, monkeypatch):
    acted = []
    agent = AGENTS["on-estimate"]
    act = agent.act
    monkeypatch.setattr(agent, "act", lambda self, *seen: acted.append(seen) or act(self, *seen))
    results = [
        attempt(trial, key_of(trial))
        for trial in trials(["mcl", "mcl-map"], scenario="guided-estimate")
    ]
    assert len(acted) == sum(result.record.steps_done for result in results)


def test_an_agent_that_says_nothing_or_inherits_looks_at_the_belief():
    class Mine(AGENTS["open-loop"]):
        """It might look."""

    (trial,) = trials(["mcl"])
    robot = Stage.of(trial).robot
    assert not sees_belief(make_agent("open-loop", robot))
    assert sees_belief(Mine(robot))


class Overwriting:
    def __init__(self, robot):
        del robot

    def reset(self, prior, plan, rng):
        return self.update(np.zeros(1), np.zeros(2), plan)

    def update(self, ranges, action, plan):
        for array in (ranges, action, plan):
            array[:] = 0.0
        return localizers.PoseBelief((1.0, 2.0, 0.0))


@localizers.registered("overwriting", Overwriting)
def test_a_localizer_that_overwrites_what_it_is_shown_changes_nothing_for_the_next(drives):
    vandal, honest = trials(["overwriting", "mcl"])
    attempt(vandal, key_of(vandal))
    after = attempt(honest, key_of(honest)).record
    _driven.cache_clear()
    assert attempt(honest, key_of(honest)).record == after


def test_records_are_the_same_on_one_job_on_two_and_resumed(tmp_path):
    asked = paper_sweep(localizers=METHODS, trials=3, lag=4, particles=30).distinct()
    made = provenance_of(asked)

    def run(out, jobs):
        with writing(out) as store:
            options = Options(where=Where(jobs=jobs), progress=False)
            run_missing({made.key(trial): trial for trial in asked}, store, options, made)
        return records(out)

    ours = run(tmp_path / "one", 1)
    assert len(ours) == len(asked)
    assert run(tmp_path / "two", 2) == ours
    lose(tmp_path / "one", 1, 3, 4)
    assert run(tmp_path / "one", 1) == ours
