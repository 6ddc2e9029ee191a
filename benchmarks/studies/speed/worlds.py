"""The environment's step, against Gymnasium's CartPole, and whole trials of the paper.

Resets are part of the time. Every side looks its actions up in a table, by the steps since its
room began: the planned lap here, actions drawn beforehand there.
"""

import math
import time
from functools import partial
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from benchmarks.execution.engines import Where
from benchmarks.scenarios import SCENARIOS
from benchmarks.studies.speed.figure import Figure, Job, Side
from benchmarks.studies.speed.work import BEAMS
from benchmarks.sweeps.running import Options, begun
from benchmarks.sweeps.suites import paper_sweep
from deqmcl_gym import ENV_ID as ROOM
from deqmcl_gym.registration import JOURNEY_ENV_ID as JOURNEY

CARTPOLE = "CartPole-v1"
FEW, MANY = 64, 1_024
PARTICLES = 1_000
PEOPLE = 40
_FEW_WORLDS, _TRIALS = 2, 20  # of a sweep, and how many more the larger one has
_HOW: dict[str, dict[str, Any]] = {ROOM: {"lidar": {"beams": BEAMS}}, CARTPOLE: {}}

Actions = NDArray[Any]


def driving(env: gym.Env[Any, Any], actions: Actions) -> Job:
    """Return the job of one env; one step a call."""
    table = list(actions)
    at = -1
    env.reset(seed=0)

    def step() -> None:
        nonlocal at
        at = (at + 1) % len(table)
        *_, terminated, truncated, _ = env.step(table[at])
        if terminated or truncated:
            env.reset()
            at = -1

    return Job(step)


def office(people: int) -> Job:
    """Return the job of a robot on planned routes through an office; one step a call.

    The world is that of the scenario lost without its driver. Resets, which look for a route, do
    not count.
    """
    crowd = {"people.number": people} if people else {}
    changed = SCENARIOS["lost"].changed({"driver": "none", "horizon": 50, **crowd})
    env = changed.in_building(0).room().unwrapped
    ahead, spent = env.reset(seed=0)[1], 0.0

    def step() -> None:
        nonlocal ahead, spent
        action, start = ahead["planned_actions"][0], time.process_time()
        *_, terminated, truncated, ahead = env.step(action)
        spent += time.process_time() - start
        if terminated or truncated:
            ahead = env.reset()[1]

    return Job(step, clock=lambda: spent)


def journeys(size: int, mode: str, *, resets: bool) -> Job:
    """Return the job of journeys driven along their plans in Gymnasium's ``mode`` of vector env.

    ``size`` steps a call. ``resets``: whether these count, which look for a route.
    """
    how: dict[str, Any] = {"vectorization_mode": mode}
    if mode == "sync":
        how["vector_kwargs"] = {"autoreset_mode": "Disabled"}
    else:
        how["autoreset_mode"] = "Disabled"
    envs = gym.make_vec(JOURNEY, num_envs=size, **how)
    ahead, spent = envs.reset(seed=0)[1]["planned_actions"], 0.0

    def step() -> None:
        nonlocal ahead, spent
        start = time.process_time()
        *_, terminated, truncated, info = envs.step(ahead[:, 0])
        ahead, ended = info["planned_actions"], terminated | truncated
        spent += time.process_time() - start
        if ended.any():
            start = time.process_time()
            info = envs.reset(options={"reset_mask": ended})[1]
            ahead[ended] = info["planned_actions"][ended]
            spent += (time.process_time() - start) * resets

    return Job(step, size, clock=lambda: spent)


def driving_all(envs: gym.vector.VectorEnv[Any, Any, Any], actions: Actions) -> Job:
    """Return the job of a vector env; ``num_envs`` steps a call."""
    at = np.full(envs.num_envs, -1)
    envs.reset(seed=0)

    def step() -> None:
        nonlocal at
        at = (at + 1) % len(actions)
        *_, terminated, truncated, _ = envs.step(actions[at])
        at[terminated | truncated] = -2  # the next action only resets

    return Job(step, envs.num_envs)


def single(name: str) -> Job:
    """Return the job of one env: the paper's room, driven along its plan, or CartPole."""
    return driving(gym.make(name, **_HOW[name]), _actions(name))


def vector(name: str, size: int) -> Job:
    """Return the job of an env's own vector env."""
    how = {"num_envs": size, "vectorization_mode": "vector_entry_point", **_HOW[name]}
    return driving_all(gym.make_vec(name, **how), _actions(name))


def trial_job(name: str, *, localizer_only: bool) -> Job:
    """Return the job of a trial as a sweep runs it, by the wall's clock: ``_TRIALS`` a call.

    A sweep of many worlds less one of few, so that starting and ending it does not count; or what
    the localizers in it take, at their median.
    """
    spent = 0.0

    def run() -> None:
        nonlocal spent
        few, many = (_seconds_of_sweep(name, n) for n in (_FEW_WORLDS, _FEW_WORLDS + _TRIALS))
        spent += _TRIALS * many[1] if localizer_only else many[0] - few[0]

    return Job(run, _TRIALS, clock=lambda: spent)


def _seconds_of_sweep(name: str, worlds: int) -> tuple[float, float]:
    """Run a sweep of ``paper``; return its seconds, and the median of its localizers'."""
    sweep = paper_sweep(localizers=[name], trials=worlds, particles=PARTICLES)
    options = Options(where=Where(jobs=1), progress=False)
    start = time.perf_counter()
    with TemporaryDirectory() as folder, begun(sweep, folder, options, command=[]) as running:
        results = running.results()
    taken = time.perf_counter() - start
    return taken, median(finished.seconds or math.nan for finished in results.records)


def _actions(name: str) -> Actions:
    if name == CARTPOLE:
        return np.random.default_rng(0).integers(0, 2, 1_000)
    _, info = gym.make(name, **_HOW[name]).reset(seed=0)
    return np.array(info["planned_actions"])


def _rooms(size: int) -> Side:
    return Side(f"{size:,} rooms, {BEAMS} beams", partial(vector, ROOM, size))


def _trial(name: str, target: float | None = None) -> Figure:
    what = f"trial of {name} in paper as a sweep runs it, N = {PARTICLES:,}; wall time"
    ours = Side("all of it", partial(trial_job, name, localizer_only=False))
    share = Side("its localizer's share", partial(trial_job, name, localizer_only=True))
    return Figure(f"trial_{name.replace('-', '_')}", what, "ms/trial", ours, share, target)


def _journeys(mode: str, words: str, *, resets: bool) -> Side:
    return Side(f"{FEW} journeys{words}", partial(journeys, FEW, mode, resets=resets))


_STEPS = "environment steps, resets included"
_IN_OFFICE = "environment steps in an office, without resets"
_SINGLE = Side(f"a room, {BEAMS} beams", partial(single, ROOM))
_CARTPOLE = Side(CARTPOLE, partial(single, CARTPOLE))
_PEOPLE = Side(f"an office with {PEOPLE} people", partial(office, PEOPLE))
_NOBODY = Side("the same without people", partial(office, 0))
_CARTPOLES = Side(f"{FEW} of {CARTPOLE}, its own vector env", partial(vector, CARTPOLE, FEW))

FIGURES = (
    _trial("mcl", 3.0),
    _trial("deq-mcl"),
    Figure("env_vs_cartpole", _STEPS, "steps/s", _SINGLE, _CARTPOLE),
    Figure("env_40_people", _IN_OFFICE, "µs/step", _PEOPLE, _NOBODY, 2.0),
    Figure("vector64_vs_cartpole_vector64", _STEPS, "steps/s", _rooms(FEW), _CARTPOLES),
    Figure("vector1024_vs_single", _STEPS, "steps/s", _rooms(MANY), _SINGLE),
    *(
        Figure(
            f"journey64_{name}",
            f"steps of Journey-v1, {words}",
            "steps/s",
            _journeys("vector_entry_point", "", resets=resets),
            _journeys("sync", ", one after the other", resets=resets),
        )
        for name, words, resets in (
            ("steps", "without resets", False),
            ("with_resets", "resets included", True),
        )
    ),
)
