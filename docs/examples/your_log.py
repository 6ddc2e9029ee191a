"""
Your log
========

``deqmcl_gym/Log-v0`` plays a recorded log as a Gymnasium environment. It reads CARMEN logs, ROS 1
and 2 bags, CSV and npz. The log in this script is recorded from a simulated robot.
"""

import tempfile
from pathlib import Path

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

import localizers
from deqmcl_gym import GridMap, logs
from deqmcl_gym.envs.wrappers import RecordLog
from deqmcl_gym.logs.motion import dead_reckoned

folder = Path(tempfile.mkdtemp())
cells = np.zeros((120, 180), np.int8)
cells[[0, -1]] = cells[:, [0, -1]] = 100
cells[40:80, 50:120] = 100
cells[0:14, 60:80] = cells[106:, 130:150] = cells[60:70, 0:20] = 100
cells[41:79, 51:119] = -1  # unknown inside, as on a map that a robot has made
cells[1:13, 61:79] = cells[107:119, 131:149] = cells[61:69, 1:19] = -1
GridMap(occupancy=cells, resolution=0.05).save(folder / "hall.yaml")

env = RecordLog(
    gym.make(
        "deqmcl_gym/Room-v0",
        floor_plan=str(folder / "hall.yaml"),
        lap={"waypoints": [[1.4, 1.2], [7.4, 1.2], [7.4, 4.8], [1.4, 4.8]]},
        lidar={"beams": 181, "field_of_view": np.pi, "max_range": 8.0, "sigma": 0.02},
        noise={"drive": 0.1, "turn": 0.1, "drift": 0.1},
        driver={},
    )
)
_, info = env.reset(seed=0)
while info["planned_count"]:
    *_, info = env.step(info["planned_actions"][0])
logs.write(env.log, folder / "lap.csv.gz")

# %%
# Play the log: actions are the odometry (forward, left, turn), observations the scans.

env = gym.make(
    "deqmcl_gym/Log-v0",
    log=str(folder / "lap.csv.gz"),
    map=str(folder / "hall.yaml"),
    every="0.1m,5deg",
    max_beams=60,
)
log = env.unwrapped
robot = localizers.RobotModel(
    floor_plan=log.floor_plan,
    lidar=log.lidar,
    motion=localizers.DifferentialMotion(),
    scan=localizers.GaussianUniform(sigma=0.2),
)
localizer = localizers.make("mcl", robot)
ranges, info = env.reset()
start = (4.4, 1.2, 0.0)
prior = localizers.GaussianPrior(mean=start, sd_position=0.2)
localizer.reset(prior, info["planned_actions"], np.random.default_rng(0))
way, actions, terminated = [], [], False
while not terminated:
    ranges, _, terminated, _, info = env.step(log.next_action)
    belief = localizer.update(ranges, info["command"], info["planned_actions"])
    way.append(localizers.best_cluster(*belief.points(), unit="m").mean)
    actions.append(info["command"])

plt.imshow(cells == 0, cmap="gray", origin="lower", extent=(0, 9, 0, 6))
plt.plot(*dead_reckoned(actions, start)[:, :2].T, "--", color="tab:gray", label="odometry alone")
plt.plot(*np.array(way)[:, :2].T, color="tab:orange", label="mcl")
plt.legend()
plt.gca().set(xlabel="m", ylabel="m", aspect="equal")
plt.show()
