"""Worlds and drives that the tests of the environment share."""

import math

import numpy as np

from deqmcl_gym.envs import RoomEnv
from deqmcl_gym.envs.wrappers import BeamDropout, Kidnap, PlanChange

ROOM_ID = "deqmcl_gym:deqmcl_gym/Room-v0"
STILL = {"drive": 0.0, "turn": 0.0, "drift": 0.0}  # no motion noise

BLOCK = [[100, 100], [250, 100], [250, 200], [100, 200]]
PAPER = {"outer": [[0, 0], [350, 0], [350, 300], [0, 300]], "obstacles": [BLOCK]}
TRIANGLE = PAPER | {"obstacles": [[[120, 90], [240, 110], [170, 210]]]}
# Of both orientations, one of them not convex.
SEVERAL = {
    "outer": [[0, 0], [500, 0], [500, 400], [0, 400]],
    "obstacles": [
        [[150, 120], [220, 130], [200, 190]],
        [[260, 270], [350, 260], [340, 130], [330, 130], [330, 240], [260, 240]],
        [[180, 230], [210, 270], [170, 280], [150, 250]],
    ],
}
# The outer wall points into the room.
POINTED = [[0, 0], [400, 0], [400, 140], [310, 150], [400, 160], [400, 300], [0, 300]]
SPIKE = {"outer": POINTED, "obstacles": [BLOCK]}
EMPTY = {"outer": [[0, 0], [0, 300], [350, 300], [350, 0]]}  # clockwise
FLOOR_PLANS = {"paper": PAPER, "triangle": TRIANGLE, "several": SEVERAL, "empty": EMPTY}

# An office and a route in it, as in the scenarios lost and driving.
WORLD = {
    "robot": {"radius": 0.25},
    "noise": {"drive": 0.1, "turn": 0.1, "drift": 0.1},
    "lap": {"step": 0.2},
    "route": {"min_length": 15.0, "max_length": 60.0},
}
SMALL = {"wings": 1, "corridors": 1}
QUICK = {"floor_plan": {"office": SMALL}, "localizer": {"name": "mcl-map", "particles": 3000}}
WRAPPED = {
    "bare": lambda env: env,
    "kidnap": lambda env: Kidnap(env, step=2),
    "dropout": lambda env: BeamDropout(env, probability=0.5),
    "plan-change": lambda env: PlanChange(env, step=2, actions=[(1, 0.1)] * 10),
    "all": lambda env: PlanChange(BeamDropout(Kidnap(env, step=2), 0.5), 3, [(1, 0.1)] * 10),
}


def hall(scale=1) -> np.ndarray:
    """Cells of 5 cm: a hall of 4.4 by 3.4 m with a pillar, around which the lap goes."""
    cells = np.pad(np.zeros((66, 86), np.int8), 1, constant_values=100)
    cells[28:40, 28:60] = 100
    cells[55:, 75:] = -1
    return np.kron(cells, np.ones((scale, scale), np.int8))


def calm(**kwargs) -> RoomEnv:
    env = RoomEnv(noise=STILL, **kwargs)
    env.reset(seed=0)
    return env


def drive(env, actions) -> list[tuple]:
    return [env.step(np.asarray(action, np.float32)) for action in actions]


def infos_of(env, seed: int = 0, most: int = 10_000) -> list[dict]:
    """What is said in an episode in which the first planned action is carried out at each step."""
    infos, ended = [env.reset(seed=seed)[1]], False
    while not ended and len(infos) <= most:
        *_, done, cut, info = env.step(infos[-1]["planned_actions"][0])
        ended = done or cut
        infos.append(info)
    return infos


def poses_of(env, actions) -> np.ndarray:
    return np.array([said[4]["truth"] for said in drive(env, actions)])


def wrapped(angles):
    return (np.asarray(angles) + math.pi) % (2 * math.pi) - math.pi


def closing_error(actions: np.ndarray) -> float:
    """How far commands of an exact lap may miss its end, px: each is half a float32 ulp off."""
    turns = np.count_nonzero(actions[:, 1])
    drives = np.count_nonzero(actions[:, 0])
    return float(actions[:, 0].sum()) * turns * 2.0**-26 + drives * 2.0**-22
