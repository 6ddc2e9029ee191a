"""What holds of every env: Gymnasium's checker, a spec in JSON, copies, seeds."""

import copy
import json
import math
import pickle
import warnings
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from drives import SQUARE, real
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from room_cases import QUICK, ROOM_ID, SMALL, WORLD, WRAPPED
from test_differences import PARTS, WORLDS

from deqmcl_gym import logs
from deqmcl_gym.envs.belief import BeliefObservation
from deqmcl_gym.envs.wrappers import Kidnap
from deqmcl_gym.maps import Lidar, Mount
from localizers import GaussianPrior, RobotModel, make

JOURNEY, LOG = "deqmcl_gym/Journey-v1", "deqmcl_gym/Log-v0"
OFFICES = {"office": SMALL | {"seeds": [0, 5]}}
MOUNTS = (Mount(x=5.0, y=2.0, heading=0.3), Mount(x=-6.0, y=-1.0, heading=math.pi))
EVERYTHING = {
    "preset": "sharp",
    "floor_plan": {"outer": [[0, 0], [300, 0], [300, 300], [0, 300]]},
    "lidar": {"beams": 4, "sigma": 2.5},
    "robot": {"radius": 6.0},
    "noise": {"drive": 0.1},
    "start": {"pose": [150, 75, 0.0], "sd_position": 3.0},
    "lap": {"step": 4.0},
    "driver": {"look_ahead": 30.0},
    "horizon": 7,
    "ends_at_goal": False,
}
ENVS = {  # id and arguments
    "room": (ROOM_ID, {"preset": "matched"}),
    "everything": (ROOM_ID, EVERYTHING),
    "guided": (ROOM_ID, {"preset": "guided"}),
    "dict": (ROOM_ID, {"preset": "guided", "observation": "dict", "horizon": 5}),
    "goes on": (ROOM_ID, {"preset": "sharp", "observation": "dict", "ends_at_goal": False}),
    "route": (ROOM_ID, {"floor_plan": {"office": SMALL}, "horizon": 20, **WORLD}),
    "mounts": (ROOM_ID, {"lidar": Lidar(beams=6, mounts=MOUNTS, min_range=3.0)}),
    "otherwise": (ROOM_ID, WORLDS["room"] | PARTS["room"]),
    "other office": (ROOM_ID, WORLDS["office"] | PARTS["office"] | {"horizon": 30}),
    "journey": (JOURNEY, {"route": {"max_length": 15.0}}),
    "journeys": (JOURNEY, {"floor_plan": OFFICES}),
    "blind": (JOURNEY, {"plan": False, "goal": "relative"}),
    "localize": ("deqmcl_gym/Localize-v0", QUICK | {"particles": 5, "cell": 10.0}),
    "localize in offices": ("deqmcl_gym/Localize-v0", QUICK | {"floor_plan": OFFICES}),
    "track": ("deqmcl_gym/Track-v0", {}),
    **{f"log {i}": (LOG, {"on_mismatch": "ignore", **options}) for i, options in enumerate(
        ({}, {"plan": "none"}, {"map": SQUARE, "every": (0.2, 0.1)}, {"segment": 0.2}))},
}  # fmt: skip
IN_JSON = sorted(set(ENVS) - {"mounts"})
# boxes are in px and rad on purpose
ALLOWED = "we recommend using a symmetric and normalized space", "is different from the unwrapped"
INFINITE = "A Box observation space maximum value is infinity"


def made(name, **more):
    kind, options = ENVS[name]
    played = {"log": real()} if kind == LOG else {}
    return gym.make(kind, **{**options, **played, **more})


def believing(observation):
    env = gym.make(ROOM_ID, preset="sharp", horizon=20, observation=observation)
    robot = RobotModel(floor_plan=env.unwrapped.floor_plan, lidar=env.unwrapped.lidar)
    prior = GaussianPrior(mean=(175.0, 50.0, 0.0))
    return BeliefObservation(env, make("mcl", robot, particles=20), prior, particles=20)


WRAPPERS = {
    **{name: lambda wrap=wrap: wrap(gym.make(ROOM_ID, lidar={"beams": 5}))
       for name, wrap in WRAPPED.items()},
    "two kidnaps": lambda: Kidnap(WRAPPED["all"](gym.make(ROOM_ID)), step=4, pose=(60, 200, 1.0)),
    **{f"belief, {shown}": partial(believing, shown) for shown in ("scan", "dict")},
}  # fmt: skip


def moves(env, count=5):
    action = np.zeros((count, *env.action_space.shape), np.float32)
    action[:, 0], action[:, 1] = env.action_space.high[0] / 4, 0.3
    action[::2, 2:-1] = 1.0
    return action


def said(env, seed=3, count=5):
    told = [env.reset(seed=seed)]
    for action in moves(env, count):
        told.append(env.step(action))
        if told[-1][2] or told[-1][3]:
            break
    return [*told, env.reset()]


@pytest.mark.parametrize("name", [*ENVS, *WRAPPERS])
def test_the_env_checker_has_nothing_to_say(name):
    if name in WRAPPERS:
        env, drawn, allowed = WRAPPERS[name](), "belief" not in name, [*ALLOWED, INFINITE]
    else:
        drawn = name not in ("other office", "journeys", "mounts")
        env = made(name, **({"render_mode": "rgb_array"} if drawn else {})).unwrapped
        allowed = [ALLOWED[0], *([INFINITE] if name == "mounts" else [])]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for text in allowed:
            warnings.filterwarnings("ignore", message=f".*{text}.*")
        check_env(env, skip_render_check=not drawn)


@pytest.mark.parametrize("name", [*IN_JSON, *WRAPPED, "two kidnaps"])
def test_a_spec_in_json_makes_the_same_again(tmp_path, name):
    if name in WRAPPERS:
        env = WRAPPERS[name]()
    elif ENVS[name][0] == LOG:
        logs.write(real(), tmp_path / "x.npz")
        env = made(name, log=str(tmp_path / "x.npz"))
    else:
        env = made(name)
    again = gym.make(EnvSpec.from_json(json.dumps(json.loads(env.spec.to_json()))))
    assert getattr(again.unwrapped, "world", 0) == getattr(env.unwrapped, "world", 0)
    np.testing.assert_equal(said(again), said(env))


@pytest.mark.parametrize("name", ["guided", "journey", "localize in offices", "track"])
def test_a_running_env_goes_on_as_its_copy_and_its_pickle_do(name):
    env = made(name).unwrapped
    env.reset(seed=5)
    env.step(moves(env)[0])
    twins = copy.deepcopy(env), pickle.loads(pickle.dumps(env))
    own = said(env, seed=None, count=3)
    for twin in twins:
        np.testing.assert_equal(said(twin, seed=None, count=3), own)


@pytest.mark.parametrize("name", sorted(ENVS))
def test_the_same_seed_gives_the_same_episodes_and_the_next_one_differs(name):
    one, other = made(name), made(name)
    np.testing.assert_equal(said(one), said(other))
    if "truth" in one.reset()[1] and one.unwrapped.spec.id != LOG and name != "mounts":
        truths = [said(one, seed=None)[-2][-1]["truth"] for _ in range(2)]
        assert (truths[0] != truths[1]).any()
