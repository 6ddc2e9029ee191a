"""The plan as an observation: what it is charged, where it moves mass."""

import math

import numpy as np
import pytest
from following import STILL, follow, same, sample_size
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import localizers
from deqmcl_gym.maps import Lidar, Map, PolygonMap
from localizers.inference.futures import tempering
from localizers.models.feasibility import PlanSensor
from localizers.models.motion import increments

INF = math.inf
RNG = np.random.default_rng
HALL = PolygonMap(
    outer=[(0, 0), (400, 0), (400, 300), (250, 300), (230, 190), (150, 200), (150, 300), (0, 300)],
    obstacles=[[(60, 60), (120, 60), (120, 80), (80, 80)], [(250, 50), (270, 120), (320, 70)]],
)
SMALL = PolygonMap(outer=[(0, 0), (3, 0), (3, 2), (0, 2)], unit="m")


class AnyMap(Map):
    def __init__(self, plan: PolygonMap) -> None:
        self.collides = plan.collides


def cloud(plan: PolygonMap, n: int, seed: int) -> np.ndarray:
    x0, y0, x1, y1 = plan.bounds
    rim = 0.1 * (x1 - x0)
    low, high = (x0 - rim, y0 - rim, -4.0), (x1 + rim, y1 + rim, 4.0)
    return RNG(seed).uniform(low, high, (n, 3)).T.astype(np.float32).copy()


@settings(max_examples=150)
@given(
    floor_plan=st.sampled_from([HALL, SMALL]),
    n=st.sampled_from([1, 7, 512, 700]),
    steps=st.integers(1, 12),
    reach=st.sampled_from([0.0, 0.01, 0.1, 1.0]),
    radius=st.sampled_from([0.0, 0.02, 0.1]),
    seed=st.integers(0, 2**32 - 1),
)
def test_one_pass_counts_steps_that_the_map_says_collide(floor_plan, n, steps, reach, radius, seed):
    size, poses = floor_plan.bounds[2], cloud(floor_plan, n, seed)
    plan = RNG(seed).normal(0, 1, (steps, 2)) * (reach * size, 1.0)
    first = seed % (steps + 1)
    sensor = PlanSensor(floor_plan=floor_plan, radius=radius * size)
    other = PlanSensor(floor_plan=AnyMap(floor_plan), radius=radius * size)
    counted = sensor.collisions(poses, plan, first)
    assert np.array_equal(counted, other.collisions(poses, plan, first))


def test_it_is_the_roll_out_of_a_motion_without_noise():
    poses, plan = cloud(HALL, 5_000, 1), RNG(2).normal((8, 0), (4, 0.3), (20, 2))
    at, count = poses, np.zeros(5_000)
    for action in plan:
        before, at = at, STILL.sample(at, action, RNG(0))
        count += HALL.collides(before.T, at.T, 8.0)
    counted = PlanSensor(floor_plan=HALL, radius=8.0).collisions(poses, plan)
    assert (counted == count).mean() > 0.998  # but where float32 just touches, or just not


@pytest.mark.parametrize("beta", [0.0, 0.5, INF])
def test_each_step_that_collides_costs_beta_and_none_costs_nothing(beta):
    poses, plan = cloud(HALL, 300, 3), np.tile([20.0, 0.1], (6, 1))
    sensor = PlanSensor(floor_plan=HALL, radius=8.0, beta=beta)
    count = sensor.collisions(poses, plan)
    assert 0 in count
    assert count.max() > 2
    expected = [0.0 if c == 0 else -beta * c for c in count.tolist()]
    assert sensor.log_likelihood(poses, plan).tolist() == expected
    assert not sensor.log_likelihood(poses, plan[:0]).any()


@settings(max_examples=300)
@given(
    logs=arrays(np.float64, st.shared(st.integers(1, 40), key="n"), elements=st.floats(-30, 0)),
    count=arrays(np.int32, st.shared(st.integers(1, 40), key="n"), elements=st.integers(0, 20)),
    beta=st.sampled_from([0.0, 0.3, 10.0, INF]),
    keep=st.sampled_from([0.0, 0.1, 0.5, 0.8, 1.0]),
)
def test_tempered_a_plan_leaves_as_much_of_the_sample_size_as_promised(logs, count, beta, keep):
    weights = np.exp(logs) / np.exp(logs).sum()
    power, feasible, log_evidence = tempering(weights, count, beta, keep)

    def after(power: float) -> np.ndarray:
        charged = np.where((count > 0) & (power > 0), power * beta * np.fmax(count, 1), 0.0)
        return weights * np.exp(-charged)

    def left(power: float) -> float:
        spared = np.where(count == count.min(), 0.0, power * beta * np.fmax(count, 1))
        least = 0.0 if count.min() == 0 else power * beta * count.min()
        relative = np.where(count == count.min(), 0.0, spared - least) if beta < INF else spared
        return sample_size(weights * np.exp(-relative)) / sample_size(weights)

    assert 0 <= power <= 1
    assert left(power) >= keep - 1e-9 or power == 0
    assert power == 1 or left(power + 2.0**-39) < keep + 1e-9
    assert feasible == pytest.approx(weights[count == 0].sum())
    total = after(power).sum()
    assert log_evidence == pytest.approx(np.log(total) if total > 0 else log_evidence, abs=1e-9)
    if keep == 0:
        assert power == 1


# A corridor with one side branch, on the left of whoever comes from the west. From the two poses,
# one turned into the other by half a turn, a beam ahead sees the same.
AROUND = [(0, 0), (400, 0), (400, 50), (125, 50), (125, 200), (75, 200), (75, 50), (0, 50)]
CORRIDOR = PolygonMap(outer=AROUND)
WEST, EAST = (60.0, 25.0, 0.0), (340.0, 25.0, math.pi)
DRIVE, LEFT = (10.0, 0.0), (0.0, math.pi / 2)
INTO_THE_BRANCH = np.array([DRIVE] * 4 + [LEFT] + [DRIVE] * 8)


class TwoPoses:
    mean = None

    def sample(self, n, rng):
        return np.array([WEST, EAST])[np.arange(n) % 2]


def in_the_corridor(**params):
    robot = localizers.RobotModel(floor_plan=CORRIDOR, lidar=Lidar(beams=1, max_range=400.0))
    return localizers.make("mcl-plan", robot, particles=100, lag=40, **params)


def mass_at_west(belief) -> float:
    poses, weights = belief.points()
    return float(weights[poses[:, 0] < 200].sum())


def followed(localizer, plans) -> list:
    stands = np.zeros((len(plans) - 1, 2)), np.full((len(plans) - 1, 1), 340.0)
    return follow(localizer, TwoPoses(), stands, plans=plans)


def test_a_plan_that_fits_one_of_two_poses_moves_the_mass_there_in_one_step():
    nothing = np.empty((0, 2))
    before, after, later = followed(in_the_corridor(keep=0.0), [nothing, INTO_THE_BRANCH, nothing])
    assert mass_at_west(before) == pytest.approx(0.5)
    assert mass_at_west(after) > 1 - 1e-9
    assert mass_at_west(later) > 1 - 1e-9  # what was seen was seen
    assert math.isnan(later.plan_reading.tempering)
    (start,) = followed(in_the_corridor(keep=0.0), [INTO_THE_BRANCH])  # π_0 counts, too
    assert mass_at_west(start) > 1 - 1e-9


def test_tempered_the_mass_moves_step_by_step_and_the_belief_says_by_how_much():
    plans = [INTO_THE_BRANCH] * 6
    beliefs = followed(in_the_corridor(keep=0.8), plans)
    shares = [mass_at_west(belief) for belief in beliefs]
    assert 0.5 < shares[0] < 0.9
    assert shares == sorted(shares)
    assert shares[-1] > 0.99
    first = beliefs[0].plan_reading
    assert 0 < first.tempering < 1
    assert first.feasible == pytest.approx(0.5)
    assert beliefs[0].effective_sample_size == pytest.approx(80, rel=1e-6)


@pytest.mark.parametrize("beta", [1.0, INF])
@pytest.mark.parametrize("keep", [0.0, 0.8])
def test_a_plan_that_nobody_can_follow_is_counted(beta, keep):
    through_walls = np.array([LEFT] + [DRIVE] * 30)
    plans = [INTO_THE_BRANCH, through_walls, through_walls]
    beliefs = followed(in_the_corridor(keep=keep, plan_beta=beta), plans)
    assert [belief.events.infeasible_plans for belief in beliefs] == [0, 1, 2]
    for belief in beliefs:
        assert np.isfinite(belief.points()[1]).all()
    assert beliefs[1].plan_reading.feasible == 0.0


@pytest.mark.parametrize("keep", [0.0, 0.8, 1.0])
def test_without_a_charge_or_a_plan_it_is_map_based_mcl_with_its_smoother(make, prior, drive, keep):
    smoother = follow(make("mcl-map-smoother", lag=5), prior, drive)
    plan_blind = follow(make("mcl-plan", lag=5, plan_beta=0.0, keep=keep), prior, drive)
    assert same(plan_blind, smoother, offsets=range(-6, 7))
    no_plan = follow(make("mcl-plan", lag=0, keep=keep), prior, drive)
    assert same(no_plan, follow(make("mcl-map"), prior, drive))
    assert not same(follow(make("mcl-plan", lag=5, keep=0.0), prior, drive), smoother)


def test_who_reads_the_first_plan_only_reports_none_of_the_later_steps(robot, prior, drive):
    made = localizers.make("mcl-map", robot, particles=9, start_draws=2)
    first, *later = follow(made, prior, drive)
    assert first.plan_reading.shown.tolist() == increments(drive[0]).tolist()
    assert [belief.plan_reading for belief in later] == [None] * len(later)


def test_the_start_keeps_the_best_of_many_draws_and_leaves_the_other_random_numbers(room, robot):
    anywhere = localizers.UniformPrior(floor_plan=room, radius=8.0)
    plan = np.tile([5.0, 0.0], (40, 1))
    sensor = PlanSensor(floor_plan=room, radius=8.0)
    shares, later = [], []
    for draws in (1, 20):
        for name in ("mcl-map", "mcl-plan"):
            made = localizers.make(name, robot, particles=300, start_draws=draws)
            rng = RNG(5)
            start = made.reset(anywhere, plan, rng)
            poses, weights = start.points()
            assert poses.shape == (300, 3)
            shares.append(float((weights * (sensor.collisions(poses.T, plan) == 0)).sum()))
            later.append(rng.random())
            made.update([100.0], [5.0, 0.0], plan[1:])
    plain, by_the_sensor, *informed = shares
    assert plain < 0.35
    assert plain < by_the_sensor  # weighted, not chosen
    assert min(informed) > 1 - 1e-9
    assert len(set(later)) == 1


def test_draws_that_were_taken_twice_are_told_apart_by_the_jitter(robot, prior):
    plan = np.tile([20.0, 0.0], (14, 1))
    clouds = [
        localizers.make("mcl-map", robot, particles=400, start_draws=2, start_jitter=jitter)
        .reset(prior, plan, RNG(1))
        .points()[0]
        for jitter in (0.0, 2.0)
    ]
    assert len(np.unique(clouds[0], axis=0)) < 400
    assert len(np.unique(clouds[1], axis=0)) == 400
    moved = (clouds[1] - clouds[0]).std(axis=0)
    assert moved == pytest.approx([2.0, 2.0, 2.0 / 280], rel=0.2)


def test_a_start_that_no_plan_fits_is_the_prior_and_is_counted(robot, prior):
    nowhere = np.tile([50.0, 0.0], (40, 1))
    made = localizers.make("mcl-map", robot, particles=50, start_draws=3, plan_beta=INF)
    start = made.reset(prior, nowhere, RNG(0))
    assert start.events.infeasible_plans == 1
    assert start.events.weight_collapses == 1
    assert start.points()[1].tolist() == [1 / 50] * 50
