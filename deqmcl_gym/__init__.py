"""A room to get lost in: the Gymnasium environment ``deqmcl_gym/Room-v0``.

>>> import gymnasium as gym, deqmcl_gym
>>> env = gym.make("deqmcl_gym/Room-v0")
"""

from gymnasium.envs.registration import register

from deqmcl_gym.config import Driver, Lap, MotionNoise, Robot, Start
from deqmcl_gym.floorplan import FloorPlan, Lidar

__all__ = ["ENV_ID", "Driver", "FloorPlan", "Lap", "Lidar", "MotionNoise", "Robot", "Start"]

ENV_ID = "deqmcl_gym/Room-v0"

# Twice the 204 steps of the planned lap in the paper's room (a test holds the two together).
register(
    id=ENV_ID,
    entry_point="deqmcl_gym.env:RoomEnv",
    vector_entry_point="deqmcl_gym.vector:RoomVectorEnv",
    max_episode_steps=408,
)
