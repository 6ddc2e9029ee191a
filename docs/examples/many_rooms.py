"""
Many rooms at once
==================

``gym.make_vec`` runs many rooms in compiled kernels. Each gives the results of a single room with
its seed, up to rounding.
"""

import time

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

import deqmcl_gym  # noqa: F401 - registers the environment

rooms = gym.make_vec("deqmcl_gym/Room-v0", num_envs=256, noise={"drift": 0.01})
ranges, info = rooms.reset(seed=0)

# %%
# All rooms have the same plan, but each has its own noise. Each carries out its next action.

truth, started = [info["truth"]], time.perf_counter()
for _ in range(200):
    ranges, rewards, terminated, truncated, info = rooms.step(info["planned_actions"][:, 0])
    truth.append(info["truth"])
print(f"{256 * 200 / (time.perf_counter() - started):,.0f} steps per second")

# %%
# The plan does not react to the noise, so errors add up.

ways = np.array(truth)
for room in range(0, 256, 4):
    plt.plot(*ways[:, room, :2].T, color="tab:blue", alpha=0.3, linewidth=0.8)
plt.gca().set(aspect="equal", title="one plan, 64 of 256 ways it went", xlabel="px", ylabel="px")
plt.show()
