"""An episode that no belief has a part in is driven once for all methods that follow on it."""

from dataclasses import replace

import pytest

from benchmarks.agents import AGENTS
from benchmarks.setup.names import make_agent
from benchmarks.setup.overrides import Named, Overrides
from benchmarks.sweeps.sweepfile import paper_sweep
from benchmarks.trials.episode import sees_belief
from benchmarks.trials.scoring import record as recorded
from benchmarks.trials.stage import Stage, _driven, attempt, key_of

METHODS = ["mcl", "deq-mcl", "mcl-map"]
DROPOUT = Overrides({"kind": "dropout", "probability": 0.3})
DISTURBED = (DROPOUT, Overrides({"kind": "kidnap", "step": 9}))
WORLDS = {
    "paper": {},
    "a start drawn, and told wrong": {"scenario": "sharp", "assumed": {"prior.kind": "displaced"}},
    "the agent shows another plan": {"scenario": "guided-stale"},
    "disturbed": {"disturbance": DISTURBED},
    "an office": {"scenario": "kidnapped"},
    "a wrong map": {"scenario": "wrong-map"},
}


def trials(names=METHODS, **setting):
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
        assert attempt(trial, key_of(trial)).record == record
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
    asked = trials(["mcl", "mcl-map"], scenario="guided-estimate")
    results = [attempt(trial, key_of(trial)) for trial in asked]
    assert len(acted) == sum(result.record.steps_done for result in results)


def test_an_agent_that_says_nothing_or_inherits_looks_at_the_belief():
    class Mine(AGENTS["open-loop"]):
        """It might look."""

    (trial,) = trials(["mcl"])
    robot = Stage.of(trial).robot
    assert not sees_belief(make_agent("open-loop", robot))
    assert sees_belief(Mine(robot))
