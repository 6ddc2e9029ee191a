"""What a person knows of a start: densities that integrate to 1, and draws that follow them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from refusals import refused
from scipy.stats import chi2

import localizers
from deqmcl_gym import GridMap, PolygonMap
from deqmcl_gym.maps import Lidar
from localizers import AnnulusRegion, GaussianPrior, MixturePrior, PolygonRegion, UniformPrior, make
from localizers.checks import default_robot

HALL = PolygonMap(((0.0, 0.0), (8.0, 0.0), (8.0, 6.0), (0.0, 6.0)), unit="m")
CELLS = np.zeros((60, 80), np.int8)
CELLS[:, 40:42] = 100
GRID = GridMap(occupancy=CELLS, resolution=0.1)
ROBOT = localizers.RobotModel(floor_plan=GRID, lidar=Lidar(beams=9, max_range=6.0, sigma=0.1))
# not convex, 4 m², as told clockwise; and free all over in the hall
CORNERS = ((1.0, 1.0), (1.0, 4.0), (3.0, 4.0), (3.0, 3.0), (2.0, 3.0), (2.0, 1.0))
ROOM = PolygonRegion(corners=CORNERS)
DOOR = AnnulusRegion(centre=(4.0, 3.0), within=1.5, beyond=0.5)
EDGE = AnnulusRegion(centre=(0.0, 3.0), within=1.0)
KITCHEN = UniformPrior(floor_plan=HALL, region=ROOM)
BED = GaussianPrior(mean=(6.0, 2.0, 3.0), sd_position=0.3, sd_heading=0.4)
TWO = MixturePrior(parts=(KITCHEN, BED), weights=(3.0, 1.0))


def density(prior, side, turns):
    """p at the middles of boxes over the hall, (nx, ny, nθ), and the volume of a box."""
    axes = [(np.arange(n) + 0.5) / n for n in (round(8 / side), round(6 / side), turns)]
    x, y, heading = np.meshgrid(*axes, indexing="ij")
    poses = np.stack([8 * x, 6 * y, 2 * np.pi * heading - np.pi], axis=-1)
    logs = prior.log_density(poses.reshape(-1, 3)).reshape(x.shape)
    return np.exp(logs), side**2 * 2 * np.pi / turns


@pytest.mark.parametrize(
    ("prior", "within"),
    [
        # edges on box sides: exact. A disc's rim of length 4π in boxes of 0.05: far below 1 %
        (KITCHEN, 1e-9),
        (UniformPrior(floor_plan=HALL, region=DOOR), 0.01),
        (UniformPrior(floor_plan=HALL, region=EDGE), 0.02),  # half of it counted
        (UniformPrior(floor_plan=GRID, region=DOOR, radius=0.16), 0.02),
        (UniformPrior(floor_plan=GRID), 0.02),
        (UniformPrior(floor_plan=HALL), 1e-9),
        (BED, 1e-6),
        (TWO, 1e-6),
        (MixturePrior(parts=(TWO, BED)), 1e-6),
    ],
)
def test_a_density_integrates_to_one(prior, within):
    values, volume = density(prior, 0.05, 24)
    assert values.sum() * volume == pytest.approx(1, abs=within)


@pytest.mark.parametrize(
    "prior",
    [
        KITCHEN,
        UniformPrior(floor_plan=GRID, region=DOOR),
        TWO,
        UniformPrior(floor_plan=GRID),
        UniformPrior(floor_plan=HALL, radius=0.16),
    ],
    ids=["room", "door", "two", "cells", "hall"],
)
def test_draws_follow_the_density(prior):
    n, fine = 20_000, density(prior, 0.05, 12)
    values = fine[0].reshape(8, 20, 6, 20, 4, 3).sum(axis=(1, 3, 5)) * fine[1]  # of 1 m, 90°
    expected = n * values / values.sum()
    x, y, heading = prior.sample(n, np.random.default_rng(1)).T
    turned = (heading + np.pi) % (2 * np.pi)
    sides = {"bins": (8, 6, 4), "range": ((0, 8), (0, 6), (0, 2 * np.pi))}
    counted = np.histogramdd((x, y, turned), **sides)[0]
    often = expected > 20
    assert counted[expected < 1e-3].sum() <= 3
    # the rim is known to 1 %: its cells may be off by that besides chance, once in 10,000
    off = np.maximum(np.abs(counted - expected)[often] - 0.02 * expected[often], 0)
    assert (off**2 / expected[often]).sum() < chi2.ppf(1 - 1e-4, often.sum() - 1)


@pytest.mark.parametrize("name", ["mcl-map", "amcl", "ekf", "grid"])
def test_filters_start_from_what_a_person_knows(name):
    room = UniformPrior(floor_plan=GRID, region=ROOM)
    prior = MixturePrior(parts=(room, BED), weights=(9.0, 1.0))
    params = {"grid": {"cell": 0.2}}.get(name, {})
    belief = make(name, ROBOT, **params).reset(prior, np.empty((0, 2)), np.random.default_rng(0))
    poses, weights = belief.points()
    share = weights[ROOM.contains(poses.astype(np.float64))].sum()
    # of 500 draws or more: 4 sigma; a Gaussian of the same moments has no such shares
    if name != "ekf":
        assert share == pytest.approx(0.9, abs=4 * math.sqrt(0.09 / 500))


@pytest.mark.parametrize("name", ["mcl", "deq-mcl", "ekf", "grid", "amcl"])
def test_a_spread_of_10_px_by_default_is_refused_on_a_map_in_metres_of_a_part_too(name):
    empty, rng = np.empty((0, 2)), np.random.default_rng(0)
    own = GaussianPrior(mean=(1.0, 1.0, 0.0))
    for prior in (own, MixturePrior(parts=(own,))):
        with refused("give sd_position in m"):
            make(name, ROBOT).reset(prior, empty, rng)
    make(name, ROBOT).reset(replace(own, sd_position=10.0), empty, rng)
    assert own == replace(own, sd_position=10.0)
    make(name, default_robot()).reset(GaussianPrior(mean=(50.0, 50.0, 0.0)), empty, rng)
