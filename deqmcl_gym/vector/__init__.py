"""Many rooms at once: ``gym.make_vec("deqmcl_gym/Room-v0", num_envs=64)``.

The same world, rules and random streams as ``deqmcl_gym.env``, without pymunk: all robots move in
one compiled kernel.
"""

from deqmcl_gym.vector.env import RoomVectorEnv

__all__ = ["RoomVectorEnv"]
