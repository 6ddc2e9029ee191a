"""The graded p(x | m): exact in the filter, and 0/1 in the limit."""

import numpy as np
import pytest
from following import follow, same
from ring import DRIVES, GRADED, METHODS, PLANS, RingWalls, worst, z_scores

from deqmcl_gym.maps import GridMap
from localizers import make
from localizers.models.feasibility import CostMap

RNG = np.random.default_rng
METHODS_ON_THE_MAP = ("mcl-map", "mcl-map-smoother", "deq-mcl", "deq-mcl-fresh",
                      "mcl-plan", "mcl-plan-hedged")  # fmt: skip


def steps(n: int) -> tuple[np.ndarray, np.ndarray]:
    before = RNG(1).uniform((-10, -10, -3), (360, 310, 3), (n, 3)).astype(np.float32).T
    return before, before + RNG(2).normal(0, 8, (3, n)).astype(np.float32)


@pytest.mark.parametrize(
    ("name", "drive"),
    [("g and past", "as planned"), ("deq", "as planned"),
     *((name, "everything") for name in ("deq, 16 pilots", "fresh", "plans"))],
)  # fmt: skip
def test_with_graded_steps_the_unnormalised_estimate_is_unbiased_for_gamma(name, drive):
    # Fails at |z| > 5, as test_ring_exactness: false alarms 6e-7 for each of about 300 figures.
    ring = (METHODS | PLANS)[name](1.0, feasibility=RingWalls(1.0, GRADED))
    assert worst(z_scores(ring, DRIVES[drive], replicates=600, costs=GRADED)) < 5


def test_a_step_costs_1_if_it_collides_else_what_the_nearest_wall_makes_of_its_end(room):
    before, after = steps(2000)
    how = {"inflation_radius": 30.0, "cost_scaling_factor": 0.1, "beta": 2.0}
    graded = CostMap(floor_plan=room, radius=8.0, **how)
    log_g = graded.log_g(before, after)
    collides = room.collides(before.T, after.T, 8.0)
    x, y = after[:2].astype(np.float64)
    outer = np.minimum.reduce([x, 350 - x, y, 300 - y])
    beside, above = np.maximum(100 - x, x - 250), np.maximum(100 - y, y - 200)
    inner = np.hypot(np.maximum(beside, 0), np.maximum(above, 0))
    distance = np.minimum(outer, inner)
    cost = np.where(distance <= 30, np.exp(-0.1 * (distance - 8)), 0.0)
    expected = np.where(collides, -2.0, -2.0 * cost)
    clear = collides | (np.abs(distance - 30) > 1e-3)  # float32 decides on which side of the edge
    np.testing.assert_allclose(log_g[clear], expected[clear], rtol=1e-4)
    assert {*np.unique(np.sign(log_g))} == {-1.0, 0.0}
    assert np.mean((log_g < 0) & ~collides) > 0.1


@pytest.mark.parametrize("beta", [0.0, 2.0, np.inf])
def test_inflated_by_no_more_than_the_robot_it_is_free_space_bit_by_bit(room, beta):
    graded = CostMap(floor_plan=room, radius=8.0, inflation_radius=8.0, beta=beta)
    plain = CostMap(floor_plan=room, radius=8.0, beta=beta)
    assert graded.log_g(*steps(5000)).tobytes() == plain.log_g(*steps(5000)).tobytes()


@pytest.mark.parametrize("name", METHODS_ON_THE_MAP)
def test_so_is_every_method_that_takes_it(robot, prior, drive, name):
    radii = ({}, {"inflation_radius": 8.0}, {"inflation_radius": 40.0})
    runs = [follow(make(name, robot, particles=50, **one), prior, drive) for one in radii]
    assert same(runs[0], runs[1])
    assert not same(runs[0], runs[2])


def test_with_an_infinite_beta_only_steps_that_cost_something_are_rejected(room):
    graded = CostMap(floor_plan=room, radius=8.0, inflation_radius=20.0, beta=np.inf)
    assert {*graded.log_g(*steps(500)).tolist()} == {0.0, -np.inf}


def test_the_default_falls_as_navs_in_either_unit(room):
    hall = GridMap(occupancy=np.zeros((20, 20), np.int8), resolution=0.1)
    for plan, radius, falloff, x in ((hall, 0.1, 10.0, 0.3), (room, 8.0, 0.2, 12.0)):
        how = {"floor_plan": plan, "radius": radius, "inflation_radius": 5 * radius}
        at = np.full((3, 1), x, np.float32)  # x from two walls
        usual, told = CostMap(**how), CostMap(**how, cost_scaling_factor=falloff)
        assert usual.log_g(at, at) == told.log_g(at, at) < 0
