"""
A corridor with identical doors
===============================

The queue of DEQ-MCL needs no room, no lidar and no poses: the paper says that it works for "any
generative model of a POMDP". Here is another one. A robot drives along a corridor of 24 cells; its
sensor says "door" or "wall", and all doors look alike. But it knows its plan: it will go in at one.
"""

import matplotlib.pyplot as plt
import numpy as np

from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.particles import Resampling
from localizers.models.scan import Scan

# %%
# **The model.** A state is a cell, or 24, the room behind the doors. An action is how many cells to
# go, or IN: through a door. Every tenth step ahead slips by one cell.

CELLS, IN = 24, 99
INSIDE = CELLS
DOORS = np.array([3, 8, 13, 18])
OPEN = np.array([13])  # the others are locked: on the map, but not seen by the sensor
IS_DOOR = np.isin(np.arange(CELLS + 1), DOORS)


class Anywhere:
    """p(x_0): any cell of the corridor."""

    def sample(self, n, rng):
        return rng.integers(0, CELLS, (n, 1))


class Drive:
    """p(x_t | x_{t-1}, a_t)."""

    def sample(self, states, action, rng):
        slips = rng.choice([-1, 0, 1], states.shape[1], p=[0.05, 0.9, 0.05])
        ahead = np.clip(states + int(action[0]) + slips, 0, CELLS - 1)
        stays = (states == INSIDE) | (action[0] == 0)
        return np.where(action[0] == IN, INSIDE, np.where(stays, states, ahead))


class DoorSensor:
    """p(o_t | x_t): says "door" (1) at a door and "wall" (0) elsewhere, nine times of ten."""

    def log_likelihood(self, states, scan):
        said = scan.ranges[0] == 1
        return np.log(np.where(IS_DOOR[states[0]] == said, 0.9, 0.1))


class Corridor:
    """g(x', x) = exp(-10) for a step through a wall or a locked door, else 1: p(x_t | m)."""

    def log_g(self, before, after):
        enters = (after[0] == INSIDE) & (before[0] != INSIDE)
        return np.where(enters & ~np.isin(before[0], OPEN), -10.0, 0.0)


# %%
# **The filters** are the parts of the room's, with these models: MCL; the same with g, which is MCL
# with map-based motion model; and DEQ-MCL, which queues the next five planned states.

MODEL = {"motion": Drive(), "scan": DoorSensor(), "resampling": Resampling(), "particles": 4000}
FILTERS = {
    "MCL": ParticleFilter(**MODEL, dtype=np.intp),
    "map-based MCL": ParticleFilter(**MODEL, feasibility=Corridor(), dtype=np.intp),
    "DEQ-MCL": ParticleFilter(**MODEL, feasibility=Corridor(), past=5, future=5, dtype=np.intp),
}

# %%
# **The episode.** The robot starts in cell 6 and drives seven cells to the open door, 13, past one
# that is locked. There it waits, sees the door three times more, and goes in.

ACTIONS = np.array([[1], [1], [1], [1], [1], [1], [1], [0], [0], [0], [IN], [0]], dtype=float)
TRUTH = [6, 7, 8, 9, 10, 11, 12, 13, 13, 13, 13, INSIDE, INSIDE]

beliefs = {name: [] for name in FILTERS}
for name, parts in FILTERS.items():
    rng = np.random.default_rng(0)
    belief = parts.initial(Anywhere(), ACTIONS, rng)
    for t, action in enumerate(ACTIONS, start=1):
        beliefs[name].append(belief)
        seen = Scan.of(np.array([float(IS_DOOR[TRUTH[t]])]), 2.0)
        belief = parts.step(belief, seen, action, ACTIONS[t:], rng)

# %%
# **What they believe.** One row per step, from t = 0; a cross marks the truth. Three doors have
# another one five cells before them, so MCL keeps three places, and so does the map alone until the
# robot has gone in. The queue of DEQ-MCL meets the step through the door five steps before it is
# made: from one place only is it possible.

figure, panels = plt.subplots(1, 3, figsize=(11, 3.8), layout="constrained", sharey=True)
for axes, (name, each) in zip(panels, beliefs.items(), strict=True):
    shares = [np.bincount(b.present[0], b.weights, CELLS + 1)[:CELLS] for b in each]
    axes.imshow(shares, cmap="Oranges", vmin=0, vmax=1, aspect="auto")
    axes.plot(TRUTH[:11], range(11), "kx", markersize=5)
    axes.set(title=name, xlabel="cell", xticks=DOORS, ylim=(10.5, -0.5))
    before = shares[9][13]
    print(f"{name}: P(at the open door) = {before:.2f}, a step before it goes in")
panels[0].set(ylabel="step")
plt.show()
