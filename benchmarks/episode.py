"""One lap: the only place that sees both the world and a localizer.

The localizer is given arrays (scan, command, plan). The true pose goes past it, to the scores.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from benchmarks.presets import ASSUMED
from benchmarks.spec import Trial
from deqmcl_gym.env import RoomEnv
from deqmcl_gym.validation import InputError, one_of
from localizers import Belief, Localizer, Prior, make

Floats = NDArray[np.floating]
Driver = Callable[[Belief, Floats], Floats]


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
    truth: Floats
    ranges: Floats
    belief: Belief
    seconds: float


def follow_plan(belief: Belief, plan: Floats) -> Floats:
    """Drive open loop: carry out the next planned action, whatever one believes."""
    action: Floats = plan[0]
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


def room_of(preset: str) -> RoomEnv:
    """Return the world of a preset, set up to run all planned steps."""
    one_of("preset", preset, ASSUMED)
    return RoomEnv(preset=preset, ends_at_goal=False)


def trial_moments(trial: Trial) -> Iterator[Moment]:
    """Run a trial; yield each step."""
    room = room_of(trial.preset)
    prior = ASSUMED[trial.preset].prior(room)
    localizer = _localizer(trial, room)
    yield from moments(room, localizer, prior, trial.filter_rng(), seed=trial.world_seed)


def check_params(trial: Trial) -> None:
    """Let a trial's localizer look at its parameters, before anything is run or written.

    Raises:
        InputError: it refuses them. Any other trouble of a plug-in is left to the trial.
    """
    room = room_of(trial.preset)
    try:
        _localizer(trial, room)
    except InputError:
        raise
    except Exception:
        return


def _localizer(trial: Trial, room: RoomEnv) -> Localizer:
    robot = ASSUMED[trial.preset].robot_model(room)
    return make(trial.localizer, robot, **dict(trial.params))


def _plan(info: dict[str, Any]) -> Floats:
    planned: Floats = info["planned_actions"][: info["planned_count"]]
    return planned
