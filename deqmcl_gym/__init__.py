"""Gymnasium environments for robot localization: ``deqmcl_gym/Room-v0`` and others.

>>> import gymnasium as gym, deqmcl_gym
>>> env = gym.make("deqmcl_gym/Room-v0")
"""

from deqmcl_gym.maps import GridMap, Lidar, Office, PolygonMap
from deqmcl_gym.registration import ENV_ID, register
from deqmcl_gym.world.config import Driver, Lap, MotionNoise, Robot, Route, Start
from deqmcl_gym.world.differences import ChangedWalls, Clutter, Glass
from deqmcl_gym.world.people import People

__version__ = "0.2.0"  # its only home: pyproject.toml reads it here

__all__ = [
    "ENV_ID",
    "ChangedWalls",
    "Clutter",
    "Driver",
    "Glass",
    "GridMap",
    "Lap",
    "Lidar",
    "MotionNoise",
    "Office",
    "People",
    "PolygonMap",
    "Robot",
    "Route",
    "Start",
]

register()
