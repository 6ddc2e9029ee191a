"""One lap: the only place that sees both the world and a localizer.

The localizer is given arrays (scan, command, plan). The true pose goes past it, to the scores.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.trials.clouds import Task
from benchmarks.trials.disturbances import disturbed
from benchmarks.trials.presets import ASSUMED, Assumptions
from benchmarks.trials.spec import Params, Trial
from deqmcl_gym.envs.room import RoomEnv
from deqmcl_gym.numerics.types import Reals
from deqmcl_gym.validation import InputError, one_of
from localizers import Belief, Localizer, Prior, make

Driver = Callable[[Belief, Reals], Reals]

_PARTS = ("floor_plan", "lidar", "robot", "noise", "start", "lap", "driver")


@dataclass(frozen=True)
class Moment:
    """A step of an episode, as seen from outside.

    Attributes:
        step: t, from 0 (reset).
        truth: the true pose x_t, (3,) px, px, rad.
        ranges: the scan o_t, (B,) px; the one at t = 0 was shown to nobody.
        belief: what the localizer believes after it.
        seconds: time the localizer took.
    """

    step: int
    truth: Reals
    ranges: Reals
    belief: Belief
    seconds: float


def follow_plan(belief: Belief, plan: Reals) -> Reals:
    """Carry out the next planned action, whatever one believes."""
    action: Reals = plan[0]
    return action


def moments(
    env: gym.Env[Any, Any],
    localizer: Localizer,
    prior: Prior,
    rng: np.random.Generator,
    *,
    seed: int,
    driver: Driver = follow_plan,
) -> Iterator[Moment]:
    """Run one episode until the plan is used up or the env ends it; yield each step.

    Args:
        env: a RoomEnv, or wrappers around one.
        localizer: fed with the env's scans, commands and plan.
        prior: p(x_0), for the localizer.
        rng: the localizer's only randomness.
        seed: for ``env.reset``.
        driver: chooses the action from the belief and the plan.
    """
    ranges, info = env.reset(seed=seed)
    plan = _plan(info)
    started = time.perf_counter()
    belief = localizer.reset(prior, plan, rng)
    yield Moment(0, info["truth"], ranges, belief, time.perf_counter() - started)
    step, ended = 0, False
    while len(plan) and not ended:
        ranges, _, terminated, truncated, info = env.step(driver(belief, plan))
        plan, step, ended = _plan(info), step + 1, terminated or truncated
        started = time.perf_counter()
        belief = localizer.update(ranges, info["action"], plan)
        yield Moment(step, info["truth"], ranges, belief, time.perf_counter() - started)


def room_of(scenario: str, world: Params = ()) -> RoomEnv:
    """Return the world of a scenario, set up to run all planned steps.

    Args:
        scenario: its name.
        world: changes to it, by dotted name: ("lidar.beams", 9).

    Raises:
        InputError: unknown scenario or name, or a bad value.
    """
    one_of("scenario", scenario, ASSUMED)
    parts: dict[str, Any] = {}
    for name, value in world:
        part, _, key = name.partition(".")
        one_of("part of the world", part, _PARTS)
        if not key:
            raise InputError(f"world.{part} is {value!r}, but must name a key: world.{part}.….")
        parts.setdefault(part, {})[key] = value
    return RoomEnv(preset=scenario, ends_at_goal=False, **parts)


def task_of(room: RoomEnv) -> Task:
    """Return what scoring must know of a room."""
    return Task(
        floor_plan=room.floor_plan,
        radius=room.world.robot.radius,
        max_range=room.lidar.max_range,
    )


def trial_moments(trial: Trial, room: RoomEnv | None = None) -> Iterator[Moment]:
    """Run a trial in its room, made here if none is given; yield each step."""
    room = room_of(trial.scenario, trial.world) if room is None else room
    env = disturbed(room, trial.disturbance)
    localizer = _localizer(trial, room)
    prior = _assumed(trial).prior(room)
    yield from moments(env, localizer, prior, trial.filter_rng(), seed=trial.world_seed)


def check_setting(trial: Trial) -> None:
    """Build a trial's world and what its filters assume, without running it.

    Raises:
        InputError: something of it is refused.
    """
    room = room_of(trial.scenario, trial.world)
    disturbed(room, trial.disturbance).reset(seed=trial.world_seed)
    _assumed(trial).robot_model(room)


def check_params(trial: Trial) -> None:
    """Let a trial's localizer look at its parameters, before anything is run or written.

    Raises:
        InputError: it refuses them. Any other trouble of a plug-in is left to the trial.
    """
    room = room_of(trial.scenario, trial.world)
    try:
        _localizer(trial, room)
    except InputError:
        raise
    except Exception:
        return


def _assumed(trial: Trial) -> Assumptions:
    return ASSUMED[trial.scenario].changed(dict(trial.assumed))


def _localizer(trial: Trial, room: RoomEnv) -> Localizer:
    return make(trial.localizer, _assumed(trial).robot_model(room), **dict(trial.params))


def _plan(info: dict[str, Any]) -> Reals:
    planned: Reals = info["planned_actions"][: info["planned_count"]]
    return planned
