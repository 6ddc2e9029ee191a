"""One lap: the only place that sees both the world and a localizer.

The localizer is given arrays (scan, command, plan), the agent what is believed and what the env
shows. The true pose goes past both, to the scores. All that the localizer is given is a copy of its
own: writing into it changes nothing else.
"""

import contextlib
import os
import time
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.setup.agent import Agent
from benchmarks.setup.logs import ReplayScenario
from benchmarks.setup.names import make_agent, scenario
from benchmarks.setup.priors import Uniform
from benchmarks.setup.scenario import Scenario
from benchmarks.setup.trial_env import TrialEnv
from benchmarks.trials.clouds import Task
from benchmarks.trials.disturbances import disturbed
from benchmarks.trials.journeys import Group, groups_named
from benchmarks.trials.spec import Params, Trial
from benchmarks.trials.symmetry import is_symmetric
from deqmcl_gym.envs.wrappers import Kidnap
from deqmcl_gym.numerics.types import Reals
from deqmcl_gym.validation import InputError
from localizers import Belief, Localizer, Prior, make
from localizers.naming.isolation import is_ctrl_c

UNKNOWN = np.full(3, np.nan)


@dataclass(frozen=True)
class Moment:
    """A step of an episode, as seen from outside.

    Attributes:
        step: t, from 0 (reset).
        truth: the true pose x_t, (3,) px, px, rad; NaN where a log has no reference.
        ranges: the scan o_t, (B,) px; the one at t = 0 was shown to nobody.
        belief: what the localizer believes after it.
        seconds: time the localizer took.
        action: the command that led here, (2,); None at t = 0.
        plan: the planned actions that the localizer was given, (h, 2); None: not known.
        collided: whether a wall stopped the robot on the way here.
        goal: where the robot is to arrive, (2,); None if nowhere.
        route: corners (x, y) of the way to it as it is planned now.
    """

    step: int
    truth: Reals
    ranges: Reals
    belief: Belief
    seconds: float
    action: Reals | None = None
    plan: Reals | None = None
    collided: bool = False
    goal: Reals | None = None
    route: tuple[tuple[float, ...], ...] | None = None


def moments(
    env: gym.Env[Any, Any],
    agent: Agent,
    localizer: Localizer,
    prior: Prior,
    rng: np.random.Generator,
    *,
    seed: int,
) -> Iterator[Moment]:
    """Run one episode until the env ends it; yield each step.

    Args:
        env: a ``TrialEnv``, or wrappers around one.
        agent: chooses the actions.
        localizer: fed with the env's scans and commands, and with the plan of whoever drives.
        prior: p(x_0), for the localizer.
        rng: the localizer's only randomness.
        seed: for ``env.reset``.
    """
    ranges, info = env.reset(seed=seed)
    truth, own = info.pop("truth", UNKNOWN), agent.plan_at_reset(info)
    ahead = _shown_plan(info) if own is None else own
    given_plan = np.array(ahead)
    started = time.perf_counter()
    belief = localizer.reset(prior, given_plan, rng)
    seconds = time.perf_counter() - started
    yield Moment(
        0, truth, ranges, belief, seconds, None, ahead, False, info.get("goal"), info.get("route")
    )
    step, ended = 0, False
    while not ended:
        action, plan = agent.act(belief, info)
        ranges, _, terminated, truncated, info = env.step(action)
        truth, step, ended = info.pop("truth", UNKNOWN), step + 1, terminated or truncated
        ahead = _shown_plan(info) if plan is None else plan
        given = ranges.copy(), info["action"].copy(), np.array(ahead)
        started = time.perf_counter()
        belief = localizer.update(*given)
        seconds = time.perf_counter() - started
        yield Moment(
            step, truth, ranges, belief, seconds, info["action"], ahead, info["collided"],
            info.get("goal"), info.get("route"),
        )  # fmt: skip


def trial_moments(trial: Trial, room: TrialEnv | None = None) -> Iterator[Moment]:
    """Run a trial in its room, made here if none is given; yield each step."""
    setup = scenario_of(trial)
    room = setup.room() if room is None else room
    env = staged(trial, room)
    env.reset(seed=trial.world_seed)  # a prior may be around the start drawn here
    agent = make_agent(setup.agent, setup.robot_model(room))
    robot, prior = deepcopy((setup.robot_model(room), setup.prior_in(room)))
    localizer = make(trial.localizer, robot, **dict(trial.params))
    yield from moments(env, agent, localizer, prior, setup.filter_rng(trial), seed=trial.world_seed)


def scenario_of(trial: Trial) -> Scenario:
    """Return a trial's scenario, with the changes that the trial makes to it, in its building.

    Raises:
        InputError: unknown scenario or name, or a bad value.
    """
    changed = scenario(trial.scenario).changed(dict(trial.world), dict(trial.assumed))
    return changed.in_building(trial.trial)


def room_of(name: str, world: Params = ()) -> TrialEnv:
    """Return the world of a scenario, set up to run all planned steps.

    Args:
        name: of the scenario.
        world: changes to it, by dotted name: ("lidar.beams", 9).

    Raises:
        InputError: unknown scenario or name, or a bad value.
    """
    return scenario(name).changed(dict(world)).room()


def task_of(room: TrialEnv) -> Task:
    """Return what scoring must know of a room."""
    return Task(
        floor_plan=room.floor_plan,
        radius=room.radius,
        max_range=room.lidar.max_range,
    )


def groups_of(trial: Trial, room: TrialEnv) -> tuple[Group, ...]:
    """Return the groups of scores that a trial is about, by the parts that it is made of.

    A robot that may be anywhere is lost; where a half turn gives the same map, two places fit. One
    that is carried off is to be found again. One that knows where it starts is to arrive where its
    route ends.
    """
    setup = scenario_of(trial)
    lost = isinstance(setup.prior, Uniform)
    if isinstance(setup, ReplayScenario):
        return ()  # its collector has them: see ``attempt.collectors_of``
    about = {
        "lost": lost,
        "ambiguity": lost and is_symmetric(room.floor_plan),
        "recovery": any(isinstance(layer, Kidnap) for layer in _layers(staged(trial, room))),
        "driving": setup.has_goal and not lost,
    }
    return groups_named([name for name, asked in about.items() if asked])


def staged(trial: Trial, room: TrialEnv) -> gym.Env[Any, Any]:
    """Return a trial's room inside its scenario's disturbances, and inside its own."""
    return disturbed(room.unwrapped, (*scenario_of(trial).disturbance, *trial.disturbance))


def _layers(env: gym.Env[Any, Any]) -> Iterator[gym.Env[Any, Any]]:
    while isinstance(env, gym.Wrapper):
        yield env
        env = env.env


def check_setting(trial: Trial) -> None:
    """Build a trial's world, what its filters assume, and its agent, without running it.

    Raises:
        InputError: something of it is refused.
    """
    setup = scenario_of(trial)
    room = setup.room()
    staged(trial, room).reset(seed=trial.world_seed)
    make_agent(setup.agent, setup.robot_model(room))
    setup.prior_in(room)


def check_params(trial: Trial) -> None:
    """Let a trial's localizer look at its parameters, before anything is run or written.

    Raises:
        InputError: it refuses them. Any other trouble of a plug-in is left to the trial.
    """
    setup = scenario_of(trial)
    robot = setup.robot_model(setup.room())
    try:
        with contextlib.chdir(os.curdir):  # comes back, wherever a localizer goes
            make(trial.localizer, robot, **dict(trial.params))
    except BaseException as error:
        if isinstance(error, InputError) or is_ctrl_c(error):
            raise


def _shown_plan(info: dict[str, Any]) -> Reals:
    planned: Reals = info["planned_actions"][: info["planned_count"]]
    return planned
