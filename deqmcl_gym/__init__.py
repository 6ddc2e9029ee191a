"""Gymnasium environments for robot localization: ``deqmcl_gym/Room-v0`` and others.

>>> import gymnasium as gym, deqmcl_gym
>>> env = gym.make("deqmcl_gym/Room-v0")

They are registered when Gymnasium is imported: localizers use the maps without it.
``deqmcl_gym/Guided-v0`` is ``Room-v0`` with ``preset="guided"``, and so on for all presets.
``Journey-v1`` has a route through an office, a driver, the goal in the observation, and no time
limit: its episodes end where their plan does. ``Localize-v0`` and ``Track-v0`` act on a belief.
"""

import math
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from deqmcl_gym.maps import GridMap, Lidar, Office, PolygonMap
from deqmcl_gym.validation import InputError
from deqmcl_gym.world import WORLDS, Driver, Lap, MotionNoise, Robot, Route, Start
from deqmcl_gym.world.differences import ChangedWalls, Clutter, Glass
from deqmcl_gym.world.people import People

__version__ = "0.2.0"  # its only home: pyproject.toml reads it here

__all__ = [
    "ENV_ID", "ChangedWalls", "Clutter", "Driver", "Glass", "GridMap", "Lap", "Lidar",
    "MotionNoise", "Office", "People", "PolygonMap", "Robot", "Route", "Start",
]  # fmt: skip

ENV_ID = "deqmcl_gym/Room-v0"
JOURNEY_ENV_ID = "deqmcl_gym/Journey-v1"
TASKS = {"deqmcl_gym/Localize-v0": "Localize", "deqmcl_gym/Track-v0": "Track"}
ABOUT = {  # what the ids are
    "Room-v0": "a lap in the paper's room, with one weak beam",
    "Paper-v0": "the same",
    "Matched-v0": "the same, from a start drawn around the expected one",
    "Sharp-v0": "the same lap, with nine sharp beams",
    "Guided-v0": "large noise, and a driver who makes a new plan at each step",
    "Journey-v1": "a route through an office, new in each episode, with a driver",
    "Log-v0": "a recorded log, played back",
    "Localize-v0": "lost in an office: find out where you are, and say so",
    "Track-v0": "reach a goal and know it, where scans cost",
}
# Twice the 204 steps of the planned lap in the paper's room (a test checks this)
MAX_EPISODE_STEPS = 408
_ROOM = "deqmcl_gym.envs:RoomEnv"


def register() -> None:
    """Register the environments, at once or when Gymnasium is imported."""
    registry = sys.modules.get("gymnasium.envs.registration")
    if registry is None:
        sys.meta_path.insert(0, _WhenGymnasiumLoads())
        return
    presets = {f"deqmcl_gym/{preset.title()}-v0": {"preset": preset} for preset in WORLDS}
    for name, kwargs in {ENV_ID: {}, **presets}.items():
        registry.register(
            id=name,
            entry_point=_ROOM,
            vector_entry_point="deqmcl_gym.envs.vector:RoomVectorEnv",
            max_episode_steps=MAX_EPISODE_STEPS,
            kwargs=kwargs,
        )
    registry.register(
        id=JOURNEY_ENV_ID,
        entry_point=_ROOM,
        vector_entry_point="deqmcl_gym.envs.vector:journeys",
        kwargs={
            "floor_plan": {"office": {}},
            "lidar": {"beams": 16, "field_of_view": 2 * math.pi, "sigma": 0.5},  # m, as an office
            "route": {},
            "driver": {},
            "observation": "dict",
            "horizon": 50,
        },
    )
    registry.register(id="deqmcl_gym/Log-v0", entry_point="deqmcl_gym.envs.log:LogEnv")
    for name, task in TASKS.items():
        many = f"{__name__}:localize" if task == "Localize" else None
        registry.register(id=name, entry_point=f"{__name__}:{task}", vector_entry_point=many)


def __getattr__(name: str) -> Any:
    """Return what makes a task; the package ``localizers`` is imported when one is made."""
    if name not in (*TASKS.values(), "localize"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        module = "localizers.many" if name == "localize" else "localizers.tasks"
        return getattr(import_module(module), name)
    except (ImportError, AttributeError):
        package = sys.modules.get("localizers")
        if package is None or hasattr(package, "RobotModel"):
            raise
        raise InputError(
            f"{name} needs deqmcl-gym's package localizers, but {package.__file__} "
            "hides it: rename that, or start Python in another folder."
        ) from None


class _WhenGymnasiumLoads:
    """Registers the environments when Gymnasium, which has its registry then, loads wrappers."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: object = None) -> None:
        if name == "gymnasium.wrappers":
            sys.meta_path.remove(self)
            register()


register()
