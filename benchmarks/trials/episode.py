"""One lap: the only place that sees both the world and a localizer.

The localizer is given copies of arrays (scan, command, plan), the agent what is believed and what
the env shows. The true pose goes past both, to the scores.
"""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from benchmarks.setup import Agent
from deqmcl_gym.numerics import Reals
from deqmcl_gym.world.driver import NO_PLAN
from localizers import Belief, Localizer, Prior

_UNKNOWN = np.full(3, np.nan)


class Step(NamedTuple):
    """A step of an episode, as seen from outside; a named tuple, as one is made at every step."""

    t: int  #: its number, from 0 (reset)
    truth: Reals  #: pose x_t, (3,), in the map's unit and rad; NaN where a log has no reference
    ranges: Reals  #: the scan o_t, (B,), in the map's unit; the one at t = 0 was shown to nobody
    belief: Belief  #: what the localizer believes after it
    seconds: float  #: time the localizer took
    action: Reals | None = None  #: the command that led here, (2,); None at t = 0
    plan: Reals | None = None  #: planned actions shown to the localizer, (h, 2); None if unknown
    collided: bool = False  #: whether a wall stopped the robot on the way here
    goal: Reals | None = None  #: where the robot is to arrive, (2,); None if nowhere
    route: tuple[tuple[float, ...], ...] | None = None  #: corners (x, y) of the way as planned now
    #: returns a picture of past, present and future, (height, width, 3); None where nobody watches
    draw: Callable[[], NDArray[np.uint8]] | None = None


def moments(
    env: gym.Env[Any, Any],
    agent: Agent,
    localizer: Localizer,
    prior: Callable[[], Prior],
    rng: np.random.Generator,
    *,
    seed: int,
) -> Iterator[Step]:
    """Run one episode of a ``TrialEnv``, or wrappers around it, to its end; yield each step.

    The localizer gets scans, commands and the driver's plans; if its ``own_plans`` is False, not
    those made from its belief. ``prior`` is asked when the episode has begun, as it may be around
    the start drawn there; ``rng`` is the localizer's only randomness.
    """
    ranges, info = env.reset(seed=seed)
    if "goal" in info:
        info["route"] = _route_of(env)
    truth = _truth_of(info)
    own = agent.plan_at_reset(_seen_by(agent, info, ranges, truth))
    ahead = _plan_of(agent, localizer, own, info)
    given_prior, given_plan = prior(), np.array(ahead)
    started = time.perf_counter()
    belief = localizer.reset(given_prior, given_plan, rng)
    seconds = time.perf_counter() - started
    yield Step(
        0, truth, ranges, belief, seconds, None, ahead, False, info.get("goal"), info.get("route")
    )
    step, ended = 0, False
    while not ended:
        action, plan = agent.act(belief, _seen_by(agent, info, ranges, truth))
        ranges, _, terminated, truncated, info = env.step(action)
        if "goal" in info:
            info["route"] = _route_of(env)
        truth, step, ended = _truth_of(info), step + 1, terminated or truncated
        ahead = _plan_of(agent, localizer, plan, info)
        given = ranges.copy(), info["command"].copy(), np.array(ahead)
        started = time.perf_counter()
        belief = localizer.update(*given)
        seconds = time.perf_counter() - started
        yield Step(
            step, truth, ranges, belief, seconds, info["command"], ahead, bool(info["collided"]),
            info.get("goal"), info.get("route")
        )  # fmt: skip


def _truth_of(info: dict[str, Any]) -> Reals:
    """Take the true pose out of ``info``; NaN if it is not known."""
    truth: Reals = info.pop("truth", _UNKNOWN)
    return truth if math.isfinite(truth.sum()) else _UNKNOWN


def _route_of(env: gym.Env[Any, Any]) -> tuple[tuple[float, ...], ...]:
    """Return the corners of the route to the goal: no env shows what varies in length."""
    room: Any = env.unwrapped
    return tuple(map(tuple, room.course.path.corners.tolist()))


def _seen_by(agent: Agent, info: dict[str, Any], ranges: Reals, truth: Reals) -> dict[str, Any]:
    """Return what an agent sees of a step."""
    seen = {**info, "ranges": ranges.copy()}
    return seen | {"truth": truth.copy()} if getattr(agent, "sees_truth", False) else seen


def _plan_of(agent: Agent, localizer: Localizer, plan: Reals | None, info: dict[str, Any]) -> Reals:
    """Return the plan that a localizer is shown: the agent's, else the env's."""
    author = info.get("plan_author") if plan is None else getattr(agent, "plan_author", None)
    if author == "own" and not getattr(localizer, "own_plans", True):
        return NO_PLAN
    shown: Reals = info["planned_actions"][: info["planned_count"]] if plan is None else plan
    return shown
