"""mcl-plan: what it is without a plan, how it starts by one, and when it doubts it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from following import follow, same, varied

import localizers
from localizers.models.motion import increments
from localizers.models.plan_sensor import PlanSensor

INF = math.inf
RNG = np.random.default_rng


@pytest.fixture(params=[{}, {"ess_threshold": 0.5}, {"resampler": "multinomial"}], ids=str)
def make(request, robot):
    def made(name: str, **params):
        return localizers.make(name, robot, particles=60, beta=2.0, **request.param, **params)

    return made


@pytest.mark.parametrize("keep", [0.0, 0.8, 1.0])
def test_without_a_charge_or_a_plan_it_is_map_based_mcl_with_its_smoother(make, prior, drive, keep):
    smoother = follow(make("mcl-map-smoother", lag=5), prior, drive)
    plan_blind = follow(make("mcl-plan", lag=5, plan_beta=0.0, keep=keep), prior, drive)
    assert same(plan_blind, smoother, offsets=range(-6, 7))
    no_plan = follow(make("mcl-plan", lag=0, keep=keep), prior, drive)
    assert same(no_plan, follow(make("mcl-map"), prior, drive))
    assert not same(follow(make("mcl-plan", lag=5, keep=0.0), prior, drive), smoother)


def test_it_looks_at_what_the_plan_still_holds(make, prior, drive):
    cut = [drive[0][t : t + 3] for t in range(13)]
    near = follow(make("mcl-plan", lag=3), prior, drive)
    far = follow(make("mcl-plan", lag=20), prior, drive, plans=cut)
    assert same(near, far)


@pytest.mark.parametrize(
    ("start_draws", "turned_from", "charged"),
    [
        # the window of t = 3 ends before the turn; at 4 its last step is the first that is turned
        (1, 8, [(5, 0)] + [(5, 4)] * 7),
        (1, 13, [(5, 0)] + [(5, 4)] * 7),
        # the start was chosen by the whole plan, so only what differs from it is left to charge
        (2, 8, [(5, 4)] * 4),
        (2, 13, []),
    ],
)
def test_a_plan_that_only_goes_on_is_charged_once_a_step(
    robot, prior, drive, start_draws, turned_from, charged
):
    # L steps at the start, then one more at each step; a changed one from where it differs
    actions, _ = drive
    turned = actions.copy()
    turned[turned_from:] += 0.1
    plans = [actions, actions[1:], turned[2:], *(turned[t:] for t in range(3, 13))]
    asked = []

    class Recording:
        beta = 1.0

        def collisions(self, states, plan, first=0):
            asked.append((len(plan), first))
            return np.zeros(states.shape[1], np.int32)

    params = {"particles": 10, "lag": 5, "start_draws": start_draws}
    made = localizers.make("mcl-plan", robot, charge="new", **params)
    evidence = replace(made.filter.lookahead, sensor=Recording())
    follow(varied(made, lookahead=evidence), prior, drive, plans=plans)
    assert asked == charged


def test_who_reads_the_first_plan_only_reports_none_of_the_later_steps(robot, prior, drive):
    first, *later = follow(
        localizers.make("mcl-map", robot, particles=9, start_draws=2), prior, drive
    )
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


def test_plans_that_are_never_doubted_are_exact_evidence(robot, prior, drive):
    sure, doubted = (
        follow(localizers.make("mcl-plan", robot, particles=50, keep=0.0, **more), prior, drive)
        for more in ({}, {"validity": 0.0})
    )
    for one, other in zip(sure, doubted, strict=True):
        assert one.weights == pytest.approx(other.weights, rel=1e-9)
    assert [b.plan_reading.valid for b in doubted[:-1]] == pytest.approx([1.0] * (len(drive[0])))


def test_a_stale_plan_is_noticed_where_the_sensor_holds_the_cloud(robot, prior, drive):
    # through the wall at every step, while the scans say where the robot is
    actions, _ = drive
    stale = [np.tile([60.0, 0.0], (20, 1)) for _ in range(len(actions) + 1)]
    doubting = localizers.make("mcl-plan", robot, particles=200, keep=0.0, validity=0.05)
    told = [b.plan_reading.valid for b in follow(doubting, prior, drive, plans=stale)]
    own = [b.plan_reading.valid for b in follow(doubting, prior, drive)][:-1]
    assert told[-1] < 0.05
    assert min(own) > 0.5
