"""What a localizer may see, and what the methods of a trial share."""

from dataclasses import replace
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

import localizers
from benchmarks.setup.names import SCENARIOS, scenario
from benchmarks.setup.overrides import Named, Overrides
from benchmarks.setup.priors import Uniform
from benchmarks.sweeps.sweepfile import paper_sweep
from benchmarks.trials.episode import moments
from benchmarks.trials.stage import Stage, attempt, key_of
from localizers import PoseBelief
from localizers.models.motion import increments

LAG, PARTICLES, SEED = 4, 30, 11
OFFSETS = (0, -LAG, LAG)
RNG = np.random.default_rng(0)
# Where the belief drives, every method has a path of its own; those left out by their beginning
# differ from others in numbers; a log must be named first.
BLINDLY_DRIVEN = [
    name
    for name in SCENARIOS
    if name not in ("log", "log-short", "replay")  # they need files
    and scenario(name).agent.name in ("open-loop", "stale")
    and not name.startswith(("lost-", "driving-", "wrong-map-", "guided-before"))
]


class Liar(gym.Wrapper):
    def __init__(self, env, lie):
        super().__init__(env)
        self._lie = np.array(lie)

    def reset(self, **options):
        ranges, info = self.env.reset(**options)
        return ranges, info | {"truth": self._lie}

    def step(self, action):
        *result, info = self.env.step(action)
        return *result, info | {"truth": self._lie}


def fitting(localizers, name):
    """Those that can start from a scenario's prior."""
    anywhere = isinstance(scenario(name).prior, Uniform)
    return [one for one in localizers if one != "dead-reckoning" or not anywhere]


def trials(localizers, scenario="paper", count=1):
    how = {"trials": 1, "seed": 5, "lag": LAG, "particles": PARTICLES}
    return paper_sweep(scenario=scenario, localizers=localizers, **how).distinct()


def believed(stage):
    """Poses and weights at each step and offset, as bytes; and the truth told."""
    points, truth = [], []
    for moment in stage.moments():
        held = [moment.belief.points(k) for k in OFFSETS]
        points.append([own and [part.tobytes() for part in own] for own in held])
        truth.append(np.array(moment.truth))
    return points, truth


@pytest.mark.parametrize("name", ["dead-reckoning", "deq-mcl", "mcl-plan-hedged"])
def test_garbage_in_place_of_the_truth_changes_no_belief_even_where_the_plan_changes(name):
    (trial,) = trials([name])
    change = Overrides({"kind": "plan-change", "step": 6, "actions": [[3.0, 0.1]] * 12})
    stage = Stage.of(replace(trial, disturbance=(change,)))
    honest, truth = believed(stage)
    assert len(truth) == 1 + 6 + 12
    for lie in ([1e6, -1e6, 99.0], [np.nan] * 3):
        deceived, told = believed(replace(stage, env=Liar(stage.env, lie)))
        assert np.array_equal(told, np.tile(lie, (len(truth), 1)), equal_nan=True)  # it got through
        assert deceived == honest


class Vandal:
    def __init__(self, robot):
        self.given = []
        self.spoil(robot)

    def reset(self, prior, plan, rng):
        self.spoil(prior, plan)
        rng.bit_generator.state = np.random.default_rng(1).bit_generator.state
        return self

    def update(self, ranges, action, plan):
        self.spoil(ranges, action, plan)
        return self

    def points(self, offset=0):
        self.spoil()
        return np.zeros((1, 3)), np.ones(1)

    def spoil(self, *more):
        self.given += more
        del self.given[3:-30]  # not robot, prior and plan
        seen, waiting = set(), [*self.given]
        while waiting:
            thing = waiting.pop()
            if id(thing) in seen:
                continue
            seen.add(id(thing))
            if isinstance(thing, np.ndarray):
                thing.flags.writeable = True
                thing[...] = 0
                waiting.append(thing.base)  # what it is a view of
            elif isinstance(thing, tuple | list):
                waiting += thing
            elif hasattr(thing, "__dict__"):
                waiting += vars(thing).values()
                for name, value in vars(thing).items():
                    if isinstance(value, float):
                        object.__setattr__(thing, name, 0.0)


@pytest.mark.parametrize("name", BLINDLY_DRIVEN)
@localizers.registered("vandal", Vandal)
def test_a_localizer_that_overwrites_all_it_was_given_changes_neither_world_nor_score(name):
    honest, vandal = trials([*fitting(["dead-reckoning", "mcl"], name)[:1], "vandal"], name)
    alone, spoilt, beside = (attempt(one, key_of(one)).record for one in (honest, vandal, honest))
    assert alone == beside != spoilt  # though all are shown what was driven once
    before, stage = Stage.of(honest).trace(), Stage.of(vandal)
    after = stage.trace()
    assert np.array_equal(after.truth, before.truth)
    assert after.scans_used == before.scans_used > 0
    present = after.offsets[0]
    distance = np.hypot(*after.truth[present.states, :2].T)
    assert present.values["energy"] == pytest.approx(distance, rel=1e-12)
    again = replace(stage, trial=honest).trace()  # in its room
    assert np.array_equal(again.offsets[0].means, before.offsets[0].means)


class Planner:
    def __init__(self):
        self.told = []

    def plan_at_reset(self, info):
        return None

    def act(self, belief, info):
        self.told.append(sorted(info))
        step = len(self.told)
        return np.array([0.0, 0.1], np.float32), np.full((step, 2), [0.0, 0.1])


class Listener:
    def reset(self, prior, plan, rng):
        self.plans = [plan]
        return PoseBelief(prior.mean)

    def update(self, ranges, action, plan):
        self.plans.append(plan)
        return PoseBelief((0.0, 0.0, 0.0))


def played(agent, localizer):
    ours = scenario("paper")
    room = ours.room()
    prior = partial(ours.prior_in, room)
    return room, list(moments(room, agent, localizer, prior, RNG, seed=SEED))


def test_the_localizer_is_told_the_plan_of_whoever_drives_and_the_agent_not_the_truth():
    agent, localizer = Planner(), Listener()
    room, seen = played(agent, localizer)
    steps = len(room.plan)
    assert len(seen) == len(localizer.plans) == steps + 1
    assert np.array_equal(localizer.plans[0], room.plan)  # nobody has believed anything yet
    for step, plan in enumerate(localizer.plans[1:], 1):
        assert np.array_equal(plan, np.full((step, 2), [0.0, 0.1]))
    told = ["collided", "command", "is_success", "planned_actions", "planned_count", "ranges"]
    assert agent.told == [told] * steps
    turned = np.unwrap([moment.truth[2] for moment in seen])
    assert turned[-1] - turned[0] == pytest.approx(0.1 * steps, rel=0.01)  # noise: 2 % of a step


class Watcher(Planner):
    """Notes the scans and true poses that it sees, and plans by itself."""

    plan_author = "own"

    def act(self, belief, info):
        self.told.append((info["ranges"], info.get("truth")))
        return np.array([0.0, 0.1], np.float32), np.full((3, 2), [0.0, 0.1])


@pytest.mark.parametrize("sees", [False, True])
def test_an_agent_sees_the_latest_scan_and_the_truth_only_if_it_says_so(sees):
    (agent := Watcher()).sees_truth = sees
    _, seen = played(agent, Listener())
    for moment, (ranges, truth) in zip(seen, agent.told, strict=False):
        assert np.array_equal(ranges, moment.ranges)
        assert np.array_equal(truth, moment.truth) if sees else truth is None


@pytest.mark.parametrize("own_plans", [False, True])
def test_a_localizer_may_leave_out_plans_made_from_its_own_belief(own_plans):
    (localizer := Listener()).own_plans = own_plans
    room, _ = played(Watcher(), localizer)
    assert len(localizer.plans[0]) == len(room.plan)  # of the env, at reset
    assert {len(plan) for plan in localizer.plans[1:]} == ({3} if own_plans else {0})


def test_a_hedge_without_own_plans_believes_what_it_does_without_any():
    law = trials(["mcl-plan-hedged"], "guided-estimate")[0]
    blind = replace(law, params=law.params | {"own_plans": False})
    for moment in Stage.of(blind).moments():
        assert moment.belief.plan_reading.shown.size == 0
        assert 0.0 < moment.belief.trusted < 1.0
    guided = replace(blind, scenario="guided")  # the plan of another: charged as ever
    theirs = Stage.of(replace(guided, params=law.params)).trace()
    assert np.array_equal(Stage.of(guided).trace().offsets[0].means, theirs.offsets[0].means)


def test_an_author_who_sees_the_true_pose_shows_the_plan_from_there():
    (law,) = trials(["mcl-plan"], "guided")
    exact = replace(law, agent=Named("misplaced"))
    first, *others = Stage.of(exact).moments()
    env = Stage.of(law).moments()
    assert np.array_equal(first.plan, next(env).plan[: len(first.plan)])
    # the env plans after the noise of the step, the author before it
    plans = [(own.plan, theirs.plan) for own, theirs in zip(others, env, strict=False)]
    apart = [np.abs(a[0] - b[0]).max() for a, b in plans if len(a) and len(b)]
    assert np.median(apart) < 0.3
    shifted = replace(law, agent=Named("misplaced", {"shift": 100.0, "turn": 0.3}))
    assert not np.array_equal(next(Stage.of(shifted).moments()).plan[:5], first.plan[:5])


def test_an_author_who_shows_plans_of_its_own_does_so_from_the_start():
    (trial,) = trials(["mcl-plan"], "guided-stale")
    seen = [moment.belief.plan_reading.shown for moment in Stage.of(trial).moments()]
    room = scenario("guided").room()
    info = room.reset(seed=trial.world_seed)[1]
    planned = info["planned_actions"][: info["planned_count"]]
    other = np.roll(planned, -(len(planned) // 8), axis=0)
    assert all(np.array_equal(seen[t], increments(other[t:])) for t in range(len(seen)))


def test_driven_on_the_estimate_the_plan_starts_from_there_and_none_is_known_before():
    (trial,) = trials(["mcl-plan"], "guided-estimate")
    first, second, *_ = Stage.of(trial).moments()
    assert len(first.belief.plan_reading.shown) == 0
    assert len(second.belief.plan_reading.shown) > LAG
