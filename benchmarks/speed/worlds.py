"""The environment's step, against Gymnasium's CartPole; resets are part of the time.

Every side looks its actions up in a table, by the steps since its room began: the planned lap
here, actions drawn beforehand there.
"""

from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from benchmarks.speed.figure import Figure, Side
from benchmarks.speed.lap import BEAMS
from benchmarks.speed.timing import Job
from deqmcl_gym import ENV_ID as ROOM

CARTPOLE = "CartPole-v1"
FEW, MANY = 64, 1_024
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


def _actions(name: str) -> Actions:
    if name == CARTPOLE:
        return np.random.default_rng(0).integers(0, 2, 1_000)
    _, info = gym.make(name, **_HOW[name]).reset(seed=0)
    return np.array(info["planned_actions"])


def _figure(name: str, ours: Side, other: Side, target: float | None = None) -> Figure:
    what = "environment steps, resets included"
    return Figure(name=name, what=what, unit="steps/s", ours=ours, other=other, target=target)


def _rooms(size: int) -> Side:
    return Side(f"{size:,} rooms, {BEAMS} beams", partial(vector, ROOM, size))


_SINGLE = Side(f"a room, {BEAMS} beams", partial(single, ROOM))
_CARTPOLE = Side(CARTPOLE, partial(single, CARTPOLE))
_CARTPOLES = Side(f"{FEW} of {CARTPOLE}, its own vector env", partial(vector, CARTPOLE, FEW))

FIGURES = (
    _figure("env_vs_cartpole", _SINGLE, _CARTPOLE, 0.5),
    _figure("vector64_vs_cartpole_vector64", _rooms(FEW), _CARTPOLES, 1.2),
    _figure("vector1024_vs_single", _rooms(MANY), _SINGLE),
)
