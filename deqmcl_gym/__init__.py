"""A room to get lost in: the Gymnasium environment ``deqmcl_gym/Room-v0``.

>>> import gymnasium as gym, deqmcl_gym
>>> env = gym.make("deqmcl_gym/Room-v0")
"""

from gymnasium.envs.registration import register

from deqmcl_gym.maps import Lidar, PolygonMap
from deqmcl_gym.world.config import Driver, Lap, MotionNoise, Robot, Start

__all__ = ["ENV_ID", "Driver", "Lap", "Lidar", "MotionNoise", "PolygonMap", "Robot", "Start"]

ENV_ID = "deqmcl_gym/Room-v0"

# Twice the 204 steps of the planned lap in the paper's room (a test holds the two together).
register(
    id=ENV_ID,
    entry_point="deqmcl_gym.envs.room:RoomEnv",
    vector_entry_point="deqmcl_gym.envs.vector:RoomVectorEnv",
    max_episode_steps=408,
)
