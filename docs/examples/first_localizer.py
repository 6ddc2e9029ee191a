"""
A first localizer
=================

Dead reckoning adds up the commands. Monte-Carlo localization (``mcl``) corrects it with the lidar;
``mcl-plan`` also uses the plan.
"""

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

import deqmcl_gym  # noqa: F401 - registers the environment
import localizers

env = gym.make("deqmcl_gym/Room-v0", preset="guided")
room = env.unwrapped

# %%
# A localizer is constructed for a map, a lidar and the noise that it should assume.

robot = localizers.RobotModel(
    floor_plan=room.floor_plan,
    lidar=room.lidar,
    radius=room.world.robot.radius,
    motion=localizers.OdometryMotion(drive=0.2, turn=0.2, drift=0.02),
    scan=localizers.CensoredGaussianUniform(sigma=100.0),
)
runners = {name: localizers.make(name, robot) for name in ("dead-reckoning", "mcl", "mcl-plan")}

# %%
# All three get the same scans, commands and plans.


def shown(info):
    return info["planned_actions"][: info["planned_count"]]


ranges, info = env.reset(seed=3)
prior = localizers.GaussianPrior(mean=room.course.start, sd_position=5.0, sd_heading=0.05)
for localizer in runners.values():
    localizer.reset(prior, shown(info), np.random.default_rng(0))

truth, ways = [], {name: [] for name in runners}
while info["planned_count"]:
    ranges, _, _, _, info = env.step(info["planned_actions"][0])
    truth.append(info["truth"])
    for name, localizer in runners.items():
        belief = localizer.update(ranges, info["command"], shown(info))
        ways[name].append(localizers.mean_pose(*belief.points()))

# %%
# How far off is each? True poses are only for scoring: no localizer gets them.

truth = np.array(truth)
figure, (lap, off) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
for corners in (room.floor_plan.outer, *room.floor_plan.obstacles):
    lap.fill(*np.array(corners).T, facecolor="none", edgecolor="black")
lap.plot(*truth[:, :2].T, color="black", linewidth=2, label="truth")
for name, poses in ways.items():
    way = np.array(poses)
    error = np.hypot(*(way - truth)[:, :2].T)
    print(f"{name}: {error.mean():.1f} px on average")
    lap.plot(*way[:, :2].T, label=name)
    off.plot(error, label=name)
lap.set(aspect="equal", title="where each believes the robot to be")
off.set(xlabel="step", ylabel="px", title="distance to the truth")
off.legend()
plt.show()
