"""What finds a robot: any localizer from a uniform prior, tempered scans, poses from anywhere."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
import ring
from following import follow, same, sample_size
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from refusals import refused

import localizers
from deqmcl_gym.maps import GridMap
from localizers.inference.loss_detector import Recovery
from localizers.inference.particle_filter import Injection, is_new
from localizers.inference.particles import power_that_keeps
from localizers.models.feasibility import PlanSensor
from localizers.models.motion import increments
from localizers.models.prior import even_poses, random_poses

RNG = np.random.default_rng
FOR_THE_LOST = ["mcl-map", "mcl-plan"]
DRIVE, TURN, BACK = (5.0, 0.0), (5.0, 0.3), (-5.0, 0.0)


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_a_place_is_found_on_a_map_that_is_nearly_full(angle):
    occupancy = np.full((4000, 4000), -1, np.int8)
    occupancy[600:640, 3000:3040] = 0  # 2 m × 2 m of 200 m × 200 m
    full = GridMap(occupancy=occupancy, resolution=0.05, origin=(3.0, -7.0, angle))
    prior = localizers.UniformPrior(floor_plan=full, radius=0.16)
    poses = prior.sample(20_000, RNG(0))
    assert full.free(poses, 0.16).all()
    corner, far = full.placed([(3000, 600), (3040, 640)])
    assert poses[:, :2].mean(axis=0) == pytest.approx((corner + far) / 2, abs=0.02)  # 6 σ
    density = prior.log_density(poses[:1])[0]
    assert density == pytest.approx(-math.log(1.68**2 * 2 * math.pi), abs=0.02)
    assert full.free(even_poses(full, 128).T).all()
    with refused("none is free for a radius of 1.1"):
        random_poses(full, 50_000, RNG(0), 1.1)


@settings(max_examples=200)
@given(
    logs=arrays(np.float64, st.shared(st.integers(2, 40), key="n"), elements=st.floats(-200, 50)),
    keep=st.sampled_from([0.0, 0.1, 0.5, 0.9]),
    weighted=st.booleans(),
)
def test_a_tempered_scan_leaves_as_much_of_the_sample_size_as_promised(logs, keep, weighted):
    before = RNG(0).normal(0, 2, logs.size) if weighted else np.zeros(logs.size)
    power = power_that_keeps(before, logs, keep)

    def left(power: float) -> float:
        both = before + power * logs
        return sample_size(np.exp(both - both.max())) / sample_size(np.exp(before))

    assert 0 <= power <= 1
    assert left(power) >= keep - 1e-9
    if not weighted:  # the sample size falls with the power
        assert power == 1 or left(power + 2.0**-19) < keep + 1e-9
    if keep == 0:
        assert power == 1


@pytest.mark.parametrize("odd", [-np.inf, np.inf])
def test_a_scan_that_nobody_or_one_too_well_explains_is_left_to_the_weights(odd):
    assert power_that_keeps(np.zeros(3), np.array([odd] * 3), 0.5) == 1.0


@pytest.mark.parametrize("name", FOR_THE_LOST)
def test_the_belief_says_at_which_power_its_scan_was_taken(name, robot, prior, drive):
    free = {"plan_beta": 0.0, "beta": 0.0}
    made = localizers.make(name, robot, particles=60, scan_keep=0.9, **free)
    kept = follow(made, prior, drive)
    assert min(belief.effective_sample_size for belief in kept) > 0.9 * 60 - 1e-6
    assert min(belief.scan_power for belief in kept) < 1
    plain = follow(localizers.make(name, robot, particles=60), prior, drive)
    assert {belief.scan_power for belief in plain} == {1.0}


@pytest.mark.parametrize("name", FOR_THE_LOST)
@pytest.mark.parametrize("more", [{}, {"ess_threshold": 0.5}])
def test_as_long_as_the_averages_agree_nothing_is_injected(name, more, robot, prior, drive):
    rates = {"recovery_alpha_slow": 0.2, "recovery_alpha_fast": 0.2}
    made = (localizers.make(name, robot, particles=60, **more, **extra) for extra in ({}, rates))
    plain, watchful = (follow(localizer, prior, drive) for localizer in made)
    assert same(plain, watchful, offsets=range(-6, 1))
    rates["recovery_alpha_fast"] = 0.9
    lost = follow(localizers.make(name, robot, particles=60, **more, **rates), prior, drive)
    assert lost[-1].events.random_poses > 0  # else they had agreed in any case
    assert not same(plain, lost)


@dataclass(frozen=True)
class Doubt(Recovery):
    """A share that does not depend on scans."""

    alpha_fast: float = 0.25
    always: float = 0.3

    @property
    def share(self) -> float:
        return self.always

    def after(self, log_evidence, beams):
        return self


@pytest.mark.parametrize("strategy", ring.RESAMPLING)
def test_with_a_given_share_the_mixture_is_exact(strategy):
    """α_t = [(1 - s) α_{t-1} T + s |α_{t-1} T| u] p(o_t | x), for eight particles; see ring."""
    share, beta, replicates = 0.3, 1.0, 1_000
    everywhere = np.full(ring.STATES, 1 / ring.STATES)

    class Uniform:
        def sample(self, n, rng):
            return rng.integers(ring.STATES, size=(n, 1))

    injection = Injection(recovery=Doubt(always=share), poses=Uniform())
    particles = ring.ring_filter(beta, resampling=ring.RESAMPLING[strategy], injection=injection)
    found = np.zeros((replicates, ring.STEPS + 1, ring.STATES))
    for seed in range(replicates):
        for t, belief in enumerate(ring.beliefs(particles, ring.AS_PLANNED, seed)):
            mass = math.exp(belief.log_evidence) * belief.weights
            found[seed, t] = np.bincount(belief.present[0], weights=mass, minlength=ring.STATES)
    exact = [ring.PRIOR]
    for command, seen in zip(ring.AS_PLANNED.executed, ring.OBSERVED, strict=True):
        moved = exact[-1] @ ring.transition(command, beta)
        mixed = (1 - share) * moved + share * moved.sum() * everywhere
        exact.append(mixed * ring.SENSOR[:, seen])
    error = found.std(axis=0, ddof=1) / math.sqrt(replicates)
    assert np.abs((found.mean(axis=0) - exact) / error).max() < 5


@pytest.mark.parametrize(
    ("last", "plan", "new"),
    [
        ([DRIVE, TURN, BACK], [TURN, BACK, BACK], False),  # the window moves on
        ([DRIVE, TURN, BACK], [], False),
        ([DRIVE, TURN, BACK], [TURN, DRIVE], True),
        ([], [DRIVE, TURN], True),
        ([DRIVE], [TURN, BACK], True),  # the goal was reached, and another one given
    ],
)
def test_a_route_is_new_that_does_not_go_on_as_the_one_before(last, plan, new):
    as_plan = [np.array(actions, dtype=float).reshape(-1, 2) for actions in (last, plan)]
    assert is_new(*as_plan) is new


@pytest.mark.parametrize("name", FOR_THE_LOST)
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_after_a_new_route_poses_are_drawn_by_it_else_anywhere(name, share, robot, prior, drive):
    straight = np.tile([5.0, 0.0, 0.0], (40, 1))  # 200 px: fits few poses in this room
    route = increments(drive[0])
    made = localizers.make(name, robot, particles=400, start_draws=20, plan_beta=10.0)
    anywhere = localizers.UniformPrior(floor_plan=robot.floor_plan, radius=robot.radius)
    injection = Injection(recovery=Doubt(always=share), poses=anywhere, start=made.filter.start)
    sensor = PlanSensor(floor_plan=robot.floor_plan, radius=robot.radius)
    belief = injection.begun(made.reset(prior, drive[0], RNG(0)), route)
    rng, news, fits = RNG(1), [], []
    for plan in (route[1:], *(straight[t:] for t in range(8))):
        before, belief = belief, injection(belief, plan, rng)
        news.append(belief.watch.news)
        if share > 0:
            drawn = (belief.present != before.present).any(axis=0)
            poses = np.ascontiguousarray(belief.present[:, drawn])
            fits.append(float((sensor.collisions(poses, plan) == 0).mean()) > 0.9)
    assert news == [0, 4, 3, 2, 1, 0, 0, 0, 0]  # as long as 1 / α_fast = 4 steps
    assert fits == [count > 0 for count in news[: len(fits)]]


def test_random_poses_come_by_the_ratio_of_the_two_averages():
    recovery = Recovery(alpha_slow=0.1, alpha_fast=0.5)
    for likelihood in (0.2, 0.4, 0.6):
        recovery = recovery.after(math.log(likelihood), 1)
        assert recovery.share == 0.0
    assert recovery.slow == pytest.approx(0.4)  # of few scans the mean
    assert recovery.fast == pytest.approx(0.3 + 0.5 * (0.6 - 0.3))
    before, recovery = recovery, recovery.after(2 * math.log(0.1), 2)  # two beams, each of 0.1
    slow = before.slow + (0.1 - before.slow) / 4
    fast = before.fast + (0.1 - before.fast) / 2
    assert recovery.share == pytest.approx(1 - fast / slow)
    assert recovery.after(math.log(0.9), 1).after(math.log(0.9), 1).share == 0.0
    assert recovery.after(0.0, 0) == recovery  # a blind scan
    assert recovery.after(-math.inf, 1).share == pytest.approx(1 - fast * 0.5 / (slow * 0.8))
    for _ in range(200):
        recovery = recovery.after(math.log(0.3), 1)
    last = recovery.after(math.log(0.7), 1)
    assert last.slow - recovery.slow == pytest.approx(0.1 * 0.4)
