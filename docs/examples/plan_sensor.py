"""
What a plan says about the present
==================================

Nobody plans through walls. A robot that is somewhere in this room is told what it will do next:
drive on, turn left, drive on. Most places where it may be are ruled out by that alone.
"""

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

import deqmcl_gym  # noqa: F401 - registers the environment
from localizers import UniformPrior
from localizers.models.plan_sensor import PlanSensor, path_of

# %%
# The robot may be anywhere, with any heading: 20,000 particles. The plan: 100 px straight on, a
# quarter turn to the left, 60 px on.

room = gym.make("deqmcl_gym/Room-v0").unwrapped.floor_plan
rng = np.random.default_rng(0)
particles = UniformPrior(floor_plan=room, radius=8.0).sample(20_000, rng)
plan = np.array([[5.0, 0.0]] * 20 + [[0.0, np.pi / 2]] + [[5.0, 0.0]] * 12)

# %%
# The plan sensor counts how many planned steps collide from each pose.

sensor = PlanSensor(floor_plan=room, radius=8.0)
feasible = sensor.collisions(particles.T.astype(np.float32), plan) == 0
print(f"{feasible.mean():.1%} of the particles survive")

# %%
# Left: some of the particles with the way that the plan would take from there. Right: those that
# survive. They lie where a robot can drive on and then turn left, in the lanes around the block.


def draw(axes, poses, colour, title):
    axes.set_title(title)
    for corners in (room.outer, *room.obstacles):
        axes.fill(*np.array(corners).T, facecolor="none", edgecolor="black", linewidth=2)
    for x, y, heading in poses:
        cosine, sine = np.cos(heading), np.sin(heading)
        way = path_of(plan) @ np.array([[cosine, sine], [-sine, cosine]]) + (x, y)
        axes.plot(*way.T, color=colour, linewidth=0.7, alpha=0.6)
        axes.plot(x, y, ".", color=colour, markersize=4)
    axes.set(aspect="equal", xticks=[], yticks=[], xlim=(-60, 410), ylim=(-60, 360))


figure, (before, after) = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained")
draw(before, particles[:150], "tab:gray", "anywhere: 150 of 20,000 particles")
draw(after, particles[feasible][:150], "tab:orange", "from here the plan is feasible")
plt.show()
