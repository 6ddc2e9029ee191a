"""The graded p(x | m): exact in the filter, 0/1 in the limit, and Nav2's values in its files."""

import json

import numpy as np
import pytest
from following import follow, same
from PIL import Image
from refusals import refused
from ring import DRIVES, GRADED, METHODS, PLANS, RingMap, worst, z_scores

from deqmcl_gym.maps import GridMap
from localizers import make
from localizers.models.feasibility import CostImage, CostMap, FreeSpace, Inflation

RNG = np.random.default_rng
METHODS_ON_THE_MAP = ("mcl-map", "mcl-map-smoother", "deq-mcl", "deq-mcl-fresh",
                      "mcl-plan", "mcl-plan-hedged")  # fmt: skip


def steps(n: int) -> tuple[np.ndarray, np.ndarray]:
    before = RNG(1).uniform((-10, -10, -3), (360, 310, 3), (n, 3)).astype(np.float32).T
    return before, before + RNG(2).normal(0, 8, (3, n)).astype(np.float32)


@pytest.mark.parametrize(
    ("name", "drive"),
    [
        ("g and past", "as planned"),
        ("deq", "as planned"),
        ("deq, 16 pilots", "everything"),
        ("fresh", "everything"),
        ("plans", "everything"),
    ],
)
def test_with_graded_steps_the_unnormalised_estimate_is_unbiased_for_gamma(name, drive):
    # Fails at |z| > 5, as test_ring_exactness: false alarms 6e-7 for each of about 300 figures.
    walls = CostMap(floor_plan=RingMap(), radius=0.0, cost=RingMap(), beta=1.0)
    ring = (METHODS | PLANS)[name](1.0, feasibility=walls)
    assert worst(z_scores(ring, DRIVES[drive], replicates=600, costs=GRADED)) < 5


def test_a_step_costs_1_if_it_collides_else_what_the_nearest_wall_makes_of_its_end(room):
    before, after = steps(2000)
    inflation = Inflation(
        floor_plan=room, radius=8.0, inflation_radius=30.0, cost_scaling_factor=0.1
    )
    log_g = CostMap(floor_plan=room, radius=8.0, cost=inflation, beta=2.0).log_g(before, after)
    collides = room.collides(before.T, after.T, 8.0)
    x, y = after[:2].astype(np.float64)
    outer = np.minimum.reduce([x, 350 - x, y, 300 - y])
    inner = np.hypot(
        np.maximum(np.maximum(100 - x, x - 250), 0), np.maximum(np.maximum(100 - y, y - 200), 0)
    )
    distance = np.minimum(outer, inner)
    cost = np.where(distance <= 30, np.exp(-0.1 * (distance - 8)), 0.0)
    expected = np.where(collides, -2.0, -2.0 * cost)
    clear = collides | (np.abs(distance - 30) > 1e-3)  # float32 decides on which side of the edge
    np.testing.assert_allclose(log_g[clear], expected[clear], rtol=1e-4)
    assert {*np.unique(np.sign(log_g))} == {-1.0, 0.0}
    assert np.mean((log_g < 0) & ~collides) > 0.1


@pytest.mark.parametrize("beta", [0.0, 2.0, np.inf])
def test_inflated_by_no_more_than_the_robot_it_is_free_space_bit_by_bit(room, beta):
    inflation = Inflation(floor_plan=room, radius=8.0, inflation_radius=8.0)
    graded = CostMap(floor_plan=room, radius=8.0, cost=inflation, beta=beta)
    plain = FreeSpace(floor_plan=room, radius=8.0, beta=beta)
    assert graded.log_g(*steps(5000)).tobytes() == plain.log_g(*steps(5000)).tobytes()


@pytest.mark.parametrize("name", METHODS_ON_THE_MAP)
def test_so_is_every_method_that_takes_it(robot, prior, drive, name):
    runs = [
        follow(make(name, robot, particles=50, **params), prior, drive)
        for params in ({}, {"inflation_radius": 8.0}, {"inflation_radius": 40.0})
    ]
    assert same(runs[0], runs[1])
    assert not same(runs[0], runs[2])


def test_with_an_infinite_beta_only_steps_that_cost_something_are_rejected(room):
    before, after = steps(500)
    inflation = Inflation(floor_plan=room, radius=8.0, inflation_radius=20.0)
    log_g = CostMap(floor_plan=room, radius=8.0, cost=inflation, beta=np.inf).log_g(before, after)
    assert {*log_g.tolist()} == {0.0, -np.inf}


def test_the_default_falls_as_navs_in_either_unit(room):
    hall = GridMap(occupancy=np.zeros((20, 20), np.int8), resolution=0.1)
    assert Inflation(floor_plan=hall, radius=0.1, inflation_radius=0.5).falloff == 10.0
    assert Inflation(floor_plan=room, radius=8.0, inflation_radius=20.0).falloff == 0.2


# ---- files

HALL = GridMap(
    occupancy=np.pad(np.zeros((8, 12), np.int8), 1, constant_values=100), resolution=0.5,
    origin=(3.0, -2.0, 0.4),
)  # fmt: skip


def written(tmp_path, values, name="costs.pgm", **said):
    """An image whose lowest row is ``values[0]``, and beside it a yaml file if anything is said."""
    image = tmp_path / name
    Image.fromarray(np.asarray(values, np.uint8)[::-1]).save(image)
    if not said:
        return image
    place = {"image": name, "mode": "trinary", "resolution": 0.5, "origin": [3.0, -2.0, 0.4]}
    rule = {"negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196}
    (tmp_path / "costs.yaml").write_text(json.dumps(place | rule | said))
    return tmp_path / "costs.yaml"


VALUES = np.full((10, 14), 0)
VALUES[4] = (0, 1, 63, 126, 252, 253, 254, 255, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize("said", [{}, {"resolution": 0.5}])
def test_values_of_a_cost_map_are_read_at_the_place_of_their_cells(tmp_path, said):
    image = CostImage.load(str(written(tmp_path, VALUES, **said)), HALL, 0.2)
    columns = np.arange(8)
    inside = RNG(0).uniform(0.01, 0.99, (2, 8))
    cells = np.column_stack([columns + inside[0], 4 + inside[1]])
    costs = image.at(HALL.placed(cells).T.astype(np.float32))
    assert costs == pytest.approx([0, 1 / 252, 0.25, 0.5, 1, 1, 1, 0])  # 255: no information


def test_off_the_image_nothing_costs(tmp_path):
    small = {"resolution": 0.1, "origin": [4.0, 0.0, 0.0]}
    path = written(tmp_path, np.r_[np.full((1, 5), 100), np.zeros((2, 5))], **small)
    image = CostImage.load(str(path), HALL, 0.1)
    around = np.array([[3.95, 0.05], [4.05, -0.05], [4.05, 0.05], [4.55, 0.05]])
    assert image.at(around.T.astype(np.float32)) == pytest.approx([0, 0, 100 / 252, 0])


def test_a_published_cost_map_is_translated_back(tmp_path):
    # Costmap2DPublisher writes 0 as 0, 1 … 252 as 1 + 97 (cost - 1) / 251, 253 as 99, 254 as 100
    costs = np.array([0, 1, 100, 252, 253, 254])
    published = np.r_[0, (1 + 97 * (costs[1:4] - 1) / 251).astype(int), 99, 100, 255]
    values = np.zeros((10, 14))
    values[4, :7] = published
    image = CostImage.load(str(written(tmp_path, values, mode="raw")), HALL, 0.2)
    found = image.at(HALL.placed(np.column_stack([np.arange(7) + 0.5, np.full(7, 4.5)])).T)
    expected = [*np.minimum(costs / 252, 1), 0]
    np.testing.assert_allclose(found, expected, atol=251 / 97 / 252)  # one step of the translation


@pytest.mark.parametrize(
    ("values", "name", "said", "words"),
    [
        (np.zeros((9, 14)), "a.pgm", {}, ("has 14x9 cells", "has 14x10: give a yaml file")),
        (np.zeros((9, 14, 3)), "a.png", {}, ("3 channels of uint8", "one channel of 8 bits")),
        (np.full((10, 14), 254), "a.pgm", {}, ("no cell below 253", "is an occupancy map")),
        (VALUES, "a.pgm", {"origin": [90.0, 0.0, 0.0]}, ("it lies elsewhere",)),
        (VALUES, "a.pgm", {"image": "none.pgm"}, ("there is no image", "none.pgm")),
        (VALUES, "a.pgm", {"resolution": 0}, ("resolution is 0",)),
    ],
)
def test_a_file_that_is_no_cost_map_of_this_floor_is_refused(tmp_path, values, name, said, words):
    path = written(tmp_path, values, name, **said)
    with refused(*words):
        CostImage.load(str(path), HALL, 0.2)


def test_an_image_alone_is_refused_on_a_map_without_cells(tmp_path, room):
    with refused("the floor plan has no cells", "give a yaml file"):
        CostImage.load(str(written(tmp_path, VALUES)), room, 8.0)
