"""
Your map
========

The environment drives in a ROS map (a yaml file and an image, as for ``map_server``).
"""

import tempfile
from pathlib import Path

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

from deqmcl_gym import GridMap

# %%
# Skip this if you have a map: a hall of 9 m by 6 m with a pillar, in cells of 5 cm.

folder = Path(tempfile.mkdtemp())
cells = np.zeros((120, 180), np.int8)
cells[[0, -1]] = cells[:, [0, -1]] = 100
cells[40:80, 50:120] = cells[0:14, 60:80] = 100
GridMap(occupancy=cells, resolution=0.05).save(folder / "hall.yaml")

# %%
# A map gives what localizers need: ranges, distances to walls, whether a robot fits.

hall = GridMap.load(folder / "hall.yaml")
x, y = np.meshgrid(np.arange(0.05, 9, 0.05), np.arange(0.05, 6, 0.05))
distance = hall.distance(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)

env = gym.make(
    "deqmcl_gym/Room-v0",
    floor_plan=str(folder / "hall.yaml"),
    lap={"waypoints": [[1.4, 1.2], [7.4, 1.2], [7.4, 4.8], [1.4, 4.8]]},
    lidar={"beams": 61, "field_of_view": np.pi, "max_range": 8.0, "sigma": 0.02},
    render_mode="rgb_array",
)
_, info = env.reset(seed=0)
for _ in range(40):
    *_, info = env.step(info["planned_actions"][0])

figure, (driven, far) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
driven.imshow(env.render())
driven.axis("off")
image = far.imshow(distance, origin="lower", extent=(0, 9, 0, 6))
figure.colorbar(image, label="m to the nearest wall", shrink=0.8)
plt.show()
