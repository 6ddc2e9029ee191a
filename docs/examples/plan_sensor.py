"""
What a plan says about the present
==================================

Nobody plans through walls. A robot somewhere in this room knows what it will do next: drive on,
turn left, drive on. That alone rules out most of the poses where it may be.
"""

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

import deqmcl_gym  # noqa: F401 - registers the environment
from localizers import UniformPrior
from localizers.models.feasibility import PlanSensor, plan_path

# %%
# The robot may be anywhere, with any heading: 20,000 particles. The plan: 150 px straight ahead, a
# quarter turn to the left, 150 px ahead.

room = gym.make("deqmcl_gym/Room-v0").unwrapped.floor_plan
rng = np.random.default_rng(0)
particles = UniformPrior(floor_plan=room, radius=8.0).sample(20_000, rng)
plan = np.array([[5.0, 0.0]] * 30 + [[0.0, np.pi / 2]] + [[5.0, 0.0]] * 30)

# %%
# From each pose, the plan sensor counts the planned steps that collide.

sensor = PlanSensor(floor_plan=room, radius=8.0)
feasible = sensor.collisions(particles.T.astype(np.float32), plan) == 0
print(f"{feasible.mean():.1%} of the particles survive")

# %%
# Left: some particles, with the path that the plan takes from there. Right: some that survive. From
# them a robot can drive ahead and then turn left, round the block.


def draw(axes, poses, colour, title):
    axes.set_title(title, pad=2)
    for corners in (room.outer, *room.obstacles):
        axes.fill(*np.array(corners).T, facecolor="none", edgecolor="black", linewidth=2)
    for x, y, heading in poses:
        cosine, sine = np.cos(heading), np.sin(heading)
        way = plan_path(plan) @ np.array([[cosine, sine], [-sine, cosine]]) + (x, y)
        axes.plot(*way.T, color=colour, linewidth=1, alpha=0.7)
        axes.plot(x, y, ".", color=colour, markersize=7)
    axes.set(aspect="equal", xticks=[], yticks=[], xlim=(-60, 410), ylim=(-60, 360))
    axes.set_axis_off()


figure, (before, after) = plt.subplots(1, 2, figsize=(10, 4.8), layout="constrained")
draw(before, particles[:50], "tab:gray", "anywhere: 50 of 20,000 particles")
draw(after, particles[feasible][:50], "tab:orange", "from here the plan is feasible")
plt.show()
