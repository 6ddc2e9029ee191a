"""
A room of your own
==================

Walls, lidar, noise and lap are arguments of ``gym.make``. Lengths here are in metres.
"""

import gymnasium as gym
import matplotlib.pyplot as plt

import deqmcl_gym  # noqa: F401 - registers the environment

env = gym.make(
    "deqmcl_gym/Room-v0",
    floor_plan={
        "unit": "m",
        "outer": [[0, 0], [9, 0], [9, 4], [6, 4], [6, 7], [0, 7]],
        "obstacles": [[[2, 2], [4, 2], [4, 5], [2, 5]]],
    },
    lidar={"beams": 31, "field_of_view": 4.7, "max_range": 6.0, "sigma": 0.03},
    noise={"drive": 0.05, "turn": 0.05, "drift": 0.02},
    render_mode="rgb_array",
)

# %%
# The planned lap runs in the middle between obstacle and outer wall.

ranges, info = env.reset(seed=1)
print(f"{info['planned_count']} planned actions; {len(ranges)} beams, in m: {ranges.round(2)}")

for _ in range(60):
    ranges, reward, terminated, truncated, info = env.step(info["planned_actions"][0])

plt.imshow(env.render())
plt.axis("off")
plt.show()
