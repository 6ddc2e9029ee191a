"""The package's filters on a log, against a small filter that shares no code with them."""

import math
from functools import cache

import numpy as np
import pytest
import yardstick
from playing import tracked

from deqmcl_gym.logs import Log, Scanner
from deqmcl_gym.logs.motion import composed, dead_reckoned, increments_of
from deqmcl_gym.maps import GridMap
from localizers import DifferentialMotion, GaussianPrior, GaussianUniform, RobotModel, make

METHODS = {
    "mcl": {"particles": 1000},
    "mcl-map": {"particles": 1000},
    "amcl": {"laser_model_type": "likelihood_field_prob"},
}


def hall() -> GridMap:
    cells = np.full((160, 220), -1, np.int8)  # 11 m x 8 m; unknown beyond the walls
    cells[10:150, 10:210] = 0
    cells[[10, 149], 10:210] = cells[10:150, [10, 209]] = 100
    cells[60:90, 80:130] = cells[11:25, 60:70] = cells[130:149, 150:165] = 100
    return GridMap(occupancy=cells, resolution=0.05)


def recorded(seed: int, laps: int = 1) -> Log:
    """Laps of 23 m on arcs and with turns on the spot, a lidar ahead of the wheels."""
    rng, turns = np.random.default_rng(seed), [(0.0, 0.0, math.pi / 20)] * 10
    lap = []
    for length in (7.0, 4.5, 7.0, 4.5):
        bends = rng.uniform(-0.02, 0.02, round(length / 0.1))
        lap += [(0.1, 0.0, bend) for bend in bends - bends.mean()] + turns
    start = (1.5, 1.6, 0.0)
    truth = dead_reckoned(np.array(lap * laps), start)
    moved = increments_of(truth)
    moved *= 1 + rng.normal(0, 0.1, moved.shape)
    scanner = Scanner(
        angles=tuple(np.linspace(-1.5, 1.5, 60)), max_range=20.0, mounting=(0.2, 0.05)
    )
    ranges = hall().ranges(composed(truth, np.array([0.2, 0.05, 0.0])), scanner.bearings)
    ranges = ranges + rng.normal(0, 0.03, ranges.shape)
    return Log(scanner, np.arange(len(truth)) * 0.1, dead_reckoned(moved), ranges, truth)


@cache
def foreign(seed: int) -> float:
    return np.median(yardstick.errors(recorded(seed), hall(), seed))


@pytest.mark.parametrize("name", METHODS)
def test_no_filter_is_much_worse_on_a_log_than_a_small_one_of_foreign_code(name):
    theirs, ours = [], []
    for seed in range(2):
        log = recorded(seed)
        theirs.append(foreign(seed))
        robot = RobotModel(
            floor_plan=hall(),
            lidar=log.scanner,
            motion=DifferentialMotion(),
            scan=GaussianUniform(sigma=0.2, power=0.1),
        )
        start = GaussianPrior(mean=tuple(log.reference[0]), sd_position=0.2, sd_heading=0.1)
        localizer, rng = make(name, robot, **METHODS[name]), np.random.default_rng(seed)
        track = tracked(log, hall(), localizer, start, rng).track
        ours.append(np.median(track.errors.translation))
    # Half as large again is what another sensor model may cost; a fault of the model of motion,
    # of the lidar's place or of unknown cells costs several times that.
    assert np.mean(ours) <= 1.5 * np.mean(theirs), (ours, theirs)
