"""
Lost in a building
==================

A robot wakes up somewhere in an office building and is given a route to drive. The route alone
rules out most places: from there it would lead through walls.
"""

import matplotlib.pyplot as plt
import numpy as np

import localizers
from benchmarks.setup.names import scenario

lost = scenario("lost").changed({"floor_plan": {"office": {"seed": 3}}})
room = lost.room()  # gym.make("deqmcl_gym/Room-v0", …) with this office, a lidar and a route
robot, prior = lost.robot_model(room), lost.prior_in(room)  # the prior: anywhere

# %%
# Both filters start with 5,000 particles anywhere in the building, and add random ones when scans
# fit badly. The second draws 20 poses for each particle and keeps one: the better the route fits
# from a pose, the likelier.

common = {"particles": 5000, "recovery_alpha_slow": 0.001, "recovery_alpha_fast": 0.1}
by_route = {"start_draws": 20, "start_jitter": 0.3}
runners = {
    "plan-blind": localizers.make("mcl-map", robot, **common),
    "start by the route": localizers.make("mcl-map", robot, **common, **by_route),
}
ranges, info = room.reset(seed=2)
route = room.unwrapped.course.path.corners
plan = info["planned_actions"][: info["planned_count"]]
beliefs = {n: one.reset(prior, plan, np.random.default_rng(0)) for n, one in runners.items()}
clouds = {name: belief.points()[0] for name, belief in beliefs.items()}

# %%
# The estimate is the mean of the heaviest cluster of particles.

start = info["truth"][:2]
truth, ways = [], {name: [] for name in runners}
while info["planned_count"]:
    ranges, _, _, _, info = room.step(info["planned_actions"][0])
    truth.append(info["truth"])
    plan = info["planned_actions"][: info["planned_count"]]
    for name, localizer in runners.items():
        belief = localizer.update(ranges, info["command"], plan)
        ways[name].append(localizers.best_cluster(*belief.points(), unit="m").mean)

# %%
# Top: all particles before the first scan, and the route from the robot (the ring), whose place no
# filter knows. Most clouds on the right are elsewhere: from there the route is feasible, too. But
# some particles are in the ring, and the first scans, which fit only there, make them the heaviest
# cluster; on the left fewer are. Bottom: position error. This is one run: `Lost, kidnapped,
# driving <../lost.html>`_ has many, and says when a route does not help.

truth = np.array(truth)
figure, axes = plt.subplot_mosaic("ab;cc", figsize=(10, 6.4), layout="constrained")
grid = room.floor_plan
height, width = np.array(grid.occupancy.shape) * grid.resolution
for view, (name, cloud) in zip("ab", clouds.items(), strict=True):
    axes[view].imshow(
        grid.occupancy == 0, cmap="gray", origin="lower", extent=(0, width, 0, height)
    )
    axes[view].plot(*route.T, color="tab:blue", linewidth=2)
    axes[view].plot(*cloud[:, :2].T, ".", color="tab:orange", markersize=1.5)
    ring = {"markersize": 14, "markerfacecolor": "none", "markeredgewidth": 2}
    axes[view].plot(*start, "o", color="tab:blue", **ring)
    near = np.hypot(*(cloud[:, :2] - start).T) < 1
    print(f"{name}: {near.sum()} of {len(cloud):,} particles within 1 m before the first scan")
    axes[view].set(title=name, xticks=[], yticks=[])
    error = np.hypot(*(np.array(ways[name]) - truth)[:, :2].T)
    print(f"{name}: within 1 m in {(error < 1).sum()} of {len(error)} steps")
    axes["c"].plot(error, label=name)
axes["c"].set(xlabel="step of 0.2 m", ylabel="m off", yscale="log")
axes["c"].legend()
plt.show()
