"""The environment's step, against Gymnasium's CartPole; episodes end and begin anew as they will.

Every side looks its actions up in a table, by the steps since its room began: the planned lap
here, actions drawn beforehand there.
"""

from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import deqmcl_gym
from benchmarks.speed.figure import Figure, Sides, UnavailableError
from benchmarks.speed.lap import BEAMS
from benchmarks.speed.timing import Job

CARTPOLE = "CartPole-v1"
ROOM: dict[str, Any] = {"lidar": {"beams": BEAMS}}
FEW, MANY = 64, 1_024

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

    return Job(call=step)


def driving_all(envs: gym.vector.VectorEnv[Any, Any, Any], actions: Actions) -> Job:
    """Return the job of a vector env; ``num_envs`` steps a call."""
    at = np.full(envs.num_envs, -1)
    envs.reset(seed=0)

    def step() -> None:
        nonlocal at
        at = (at + 1) % len(actions)
        *_, terminated, truncated, _ = envs.step(actions[at])
        at[terminated | truncated] = -2  # the next action only resets

    return Job(call=step, amount=envs.num_envs)


def room_job() -> Job:
    """Return the job of our env, driven along its plan."""
    env = gym.make(deqmcl_gym.ENV_ID, **ROOM)
    return driving(env, _planned(env))


def cartpole_job() -> Job:
    """Return the job of CartPole."""
    return driving(gym.make(CARTPOLE), _pushes())


def rooms_job(rooms: int) -> Job:
    """Return the job of our vector env.

    Raises:
        UnavailableError: there is none.
    """
    if gym.spec(deqmcl_gym.ENV_ID).vector_entry_point is None:
        raise UnavailableError(f"{deqmcl_gym.ENV_ID} has no vector_entry_point")
    envs = _vector(deqmcl_gym.ENV_ID, rooms, **ROOM)
    return driving_all(envs, _planned(gym.make(deqmcl_gym.ENV_ID, **ROOM)))


def cartpoles_job(poles: int) -> Job:
    """Return the job of Gymnasium's CartPole vector env."""
    return driving_all(_vector(CARTPOLE, poles), _pushes())


def _vector(name: str, size: int, **how: Any) -> Any:
    return gym.make_vec(name, num_envs=size, vectorization_mode="vector_entry_point", **how)


def _planned(env: gym.Env[Any, Any]) -> Actions:
    _, info = env.reset(seed=0)
    planned: Actions = np.array(info["planned_actions"])
    return planned


def _pushes() -> Actions:
    return np.random.default_rng(0).integers(0, 2, 1_000)


def _rooms_vs_cartpoles(size: int) -> Sides:
    return rooms_job(size), cartpoles_job(size)


_OURS = f"Room-v0, {BEAMS} beams"

FIGURES = (
    Figure(
        name="env_vs_cartpole",
        task="environment steps, resets included",
        ours=f"{_OURS}, pymunk inside",
        other=CARTPOLE,
        unit="steps/s",
        target=0.5,
        sides=lambda: (room_job(), cartpole_job()),
    ),
    *(
        Figure(
            name=f"vector{size}_vs_cartpole_vector{size}",
            task=f"vector environment steps, {size:,} at a time",
            ours=f"{_OURS}, {size:,} rooms",
            other=f"{CARTPOLE}, its own vector env of {size:,}",
            unit="steps/s",
            target=target,
            sides=partial(_rooms_vs_cartpoles, size),
        )
        for size, target in ((FEW, 1.2), (MANY, None))
    ),
    Figure(
        name="vector1024_vs_single",
        task="environment steps, resets included",
        ours=f"{_OURS}, vector env of {MANY:,} rooms",
        other=f"{_OURS}, a single env",
        unit="steps/s",
        sides=lambda: (rooms_job(MANY), room_job()),
    ),
)
