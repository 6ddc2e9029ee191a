"""One lap: the only place that sees both the world and a localizer.

The localizer is given copies of arrays (scan, command, plan), the agent what is believed and what
the env shows. The true pose goes past both, to the scores.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import count
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from benchmarks.setup import Agent
from deqmcl_gym.numerics import Reals
from deqmcl_gym.validation import InputError
from deqmcl_gym.world.driver import NO_PLAN
from localizers import Belief, Localizer, Prior

_UNKNOWN = np.full(3, np.nan)
_NOBODY: Any = None  # who follows what is driven


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
    own: bool = False  #: whether the plan is made from the belief


def sees_belief(agent: Agent) -> bool:
    """Whether what an agent does may depend on the belief, unless its own class denies it."""
    return bool(vars(type(agent)).get("sees_belief", True))


def drive(
    env: gym.Env[Any, Any], agent: Agent, believed: Callable[[], Any], *, seed: int
) -> Iterator[Step]:
    """Run one episode of a ``TrialEnv``, or wrappers around it, to its end; yield each step.

    Nobody follows it: the belief is None.
    """
    ranges, info = env.reset(seed=seed)
    action: Reals | None = None
    plan: Reals | None = None
    ended = False
    for t in count():
        truth: Reals = info.pop("truth", _UNKNOWN)
        truth = truth if math.isfinite(truth.sum()) else _UNKNOWN
        if "goal" in info:  # its route varies in length, so that no env shows it
            room: Any = env.unwrapped
            info["route"] = tuple(map(tuple, room.course.path.corners.tolist()))
        seen = {**info, "ranges": ranges.copy()}
        if getattr(agent, "sees_truth", False):
            seen["truth"] = truth.copy()
        if t == 0:
            plan = agent.plan_at_reset(seen)
        author = info.get("plan_author") if plan is None else getattr(agent, "plan_author", None)
        shown = info["planned_actions"][: info["planned_count"]] if plan is None else plan
        collided = action is not None and bool(info["collided"])
        goal, route, own = info.get("goal"), info.get("route"), author == "own"
        yield Step(t, truth, ranges, _NOBODY, 0.0, action, shown, collided, goal, route, own=own)
        if ended:
            return
        choice, plan = agent.act(believed(), seen)
        ranges, _, terminated, truncated, info = env.step(choice)
        action, ended = info["command"], terminated or truncated


def followed(
    driven: Callable[[Callable[[], Any]], Iterable[Step]],
    localizer: Localizer,
    prior: Callable[[], Prior],
    rng: np.random.Generator,
) -> Iterator[Step]:
    """Let a localizer follow an episode, ``driven`` by what it believes, to its end.

    The localizer gets scans, commands and the driver's plans; if its ``own_plans`` is False, not
    those made from its belief. ``prior`` is asked when the episode has begun, as it may be around
    the start drawn there; ``rng`` is the localizer's only randomness.
    """
    belief: Any = None
    takes_own = getattr(localizer, "own_plans", True)
    steps = driven(lambda: belief)
    for shown in steps:
        plan = NO_PLAN if shown.own and not takes_own else shown.plan
        call: Callable[..., Belief] = localizer.update
        arguments: tuple[Any, ...]
        if shown.t == 0:
            call, arguments = localizer.reset, (prior(), np.array(plan), rng)
        else:
            arguments = shown.ranges.copy(), np.array(shown.action), np.array(plan)
        started = time.perf_counter()
        belief = call(*arguments)
        seconds = time.perf_counter() - started
        if not hasattr(belief, "points"):
            raise InputError(
                f"{'update' if shown.t else 'reset'} (step {shown.t}) returned "
                f"{type(belief).__name__}, but must return a belief: an object with points(offset)."
            )
        yield shown._replace(belief=belief, seconds=seconds, plan=plan)


def moments(
    env: gym.Env[Any, Any],
    agent: Agent,
    localizer: Localizer,
    prior: Callable[[], Prior],
    rng: np.random.Generator,
    *,
    seed: int,
) -> Iterator[Step]:
    """Run one episode and let a localizer follow it; yield each step."""
    return followed(partial(drive, env, agent, seed=seed), localizer, prior, rng)
