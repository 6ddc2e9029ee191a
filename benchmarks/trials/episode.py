"""One lap: the only place that sees both the world and a localizer.

The localizer is given arrays (scan, command, plan), the agent what is believed and what the env
shows. The true pose goes past both, to the scores. All that the localizer is given is a copy of its
own: what it writes into it concerns nobody else.
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
from benchmarks.setup.names import make_agent, scenario
from benchmarks.setup.scenario import Scenario
from benchmarks.trials.clouds import Task
from benchmarks.trials.disturbances import disturbed
from benchmarks.trials.spec import Params, Trial
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.numerics.types import Reals
from deqmcl_gym.validation import InputError
from localizers import Belief, Localizer, Prior, make
from localizers.naming.isolation import is_ctrl_c


@dataclass(frozen=True)
class Moment:
    """A step of an episode, as seen from outside.

    Attributes:
        step: t, from 0 (reset).
        truth: the true pose x_t, (3,) px, px, rad.
        ranges: the scan o_t, (B,) px; the one at t = 0 was shown to nobody.
        belief: what the localizer believes after it.
        seconds: time the localizer took.
        action: the command that led here, (2,); None at t = 0.
    """

    step: int
    truth: Reals
    ranges: Reals
    belief: Belief
    seconds: float
    action: Reals | None = None


def moments(
    env: gym.Env[Any, Any],
    agent: Agent,
    localizer: Localizer,
    prior: Prior,
    rng: np.random.Generator,
    *,
    seed: int,
) -> Iterator[Moment]:
    """Run one episode until the env's plan is used up or the env ends it; yield each step.

    Args:
        env: a RoomEnv, or wrappers around one.
        agent: chooses the actions.
        localizer: fed with the env's scans and commands, and with the plan of whoever drives.
        prior: p(x_0), for the localizer.
        rng: the localizer's only randomness.
        seed: for ``env.reset``.
    """
    ranges, info = env.reset(seed=seed)
    truth, shown = info.pop("truth"), _shown_plan(info)
    own = agent.plan_at_reset(info)
    given_plan = np.array(shown if own is None else own)
    started = time.perf_counter()
    belief = localizer.reset(prior, given_plan, rng)
    yield Moment(0, truth, ranges, belief, time.perf_counter() - started)
    step, ended = 0, False
    while len(shown) and not ended:
        action, plan = agent.act(belief, info)
        ranges, _, terminated, truncated, info = env.step(action)
        truth, shown = info.pop("truth"), _shown_plan(info)
        step, ended = step + 1, terminated or truncated
        ahead = shown if plan is None else plan
        given = ranges.copy(), info["action"].copy(), np.array(ahead)
        started = time.perf_counter()
        belief = localizer.update(*given)
        seconds = time.perf_counter() - started
        yield Moment(step, truth, ranges, belief, seconds, info["action"])


def trial_moments(trial: Trial, room: RoomEnv | None = None) -> Iterator[Moment]:
    """Run a trial in its room, made here if none is given; yield each step."""
    setup = scenario_of(trial)
    room = setup.room() if room is None else room
    env = disturbed(room, (*setup.disturbance, *trial.disturbance))
    if room.world.route is not None:
        env.reset(seed=trial.world_seed)  # draws the start, of which a prior may know
    agent = make_agent(setup.agent, setup.robot_model(room))
    robot, prior = deepcopy((setup.robot_model(room), setup.prior_in(room)))
    localizer = make(trial.localizer, robot, **dict(trial.params))
    yield from moments(env, agent, localizer, prior, trial.filter_rng(), seed=trial.world_seed)


def scenario_of(trial: Trial) -> Scenario:
    """Return a trial's scenario, with the changes that the trial makes to it, in its building.

    Raises:
        InputError: unknown scenario or name, or a bad value.
    """
    changed = scenario(trial.scenario).changed(dict(trial.world), dict(trial.assumed))
    return changed.in_building(trial.trial)


def room_of(name: str, world: Params = ()) -> RoomEnv:
    """Return the world of a scenario, set up to run all planned steps.

    Args:
        name: of the scenario.
        world: changes to it, by dotted name: ("lidar.beams", 9).

    Raises:
        InputError: unknown scenario or name, or a bad value.
    """
    return scenario(name).changed(dict(world)).room()


def task_of(room: RoomEnv) -> Task:
    """Return what scoring must know of a room."""
    return Task(
        floor_plan=room.floor_plan,
        radius=room.world.robot.radius,
        max_range=room.lidar.max_range,
    )


def check_setting(trial: Trial) -> None:
    """Build a trial's world, what its filters assume, and its agent, without running it.

    Raises:
        InputError: something of it is refused.
    """
    setup = scenario_of(trial)
    room = setup.room()
    wrappers = (*setup.disturbance, *trial.disturbance)
    disturbed(room, wrappers).reset(seed=trial.world_seed)
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
