"""Weights of any size make a distribution or count a collapse; resampling; the best cluster."""

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from following import follow, started, updated
from hypothesis import given, settings
from hypothesis import strategies as st

import localizers
from deqmcl_gym.maps import Lidar
from localizers import best_cluster, mean_pose
from localizers.inference import particles
from localizers.inference.belief import ParticleBelief, Queue
from localizers.inference.particles import SCHEMES, Resampling, log_sum_exp
from localizers.methods import grid as grid_motion
from localizers.methods.classical import gaussian_points, sigma_points
from localizers.models.scan import Scan

INF = math.inf
LOG = st.sampled_from([0.0, -INF, -1e308, 1e308, -745.2, -1e-300]) | st.floats(-1.7e308, 1e3)
SHARE = st.sampled_from([0.0, 1e-300, 1e-16, 1.0]) | st.floats(0, 1)
quietly = pytest.mark.filterwarnings("error")  # inf - inf and 0 · inf would say so
INTO_THE_WALL = np.tile([-80.0, 0.0], (6, 1))  # from (50, 50, 0): x = -30 after the first step
AHEAD = np.tile([10.0, 0.0], (6, 1))
SCANS = np.full((6, 1), 250.0)


def lists(of, least=1, most=60):
    alike = st.builds(lambda one, n: [one] * n, of, st.integers(least, most))
    return st.lists(of, min_size=least, max_size=most) | alike


PAIRS = st.integers(1, 60).flatmap(lambda n: st.tuples(lists(LOG, n, n), lists(LOG, n, n)))


def shares_of(logs: list[float]) -> list[float]:
    """exp(log w) / Σ exp(log w), in plain arithmetic; none if all are 0, or one is infinite."""
    top = max(logs)
    weights = [] if math.isinf(top) else [math.exp(log - top) for log in logs]
    return [weight / math.fsum(weights) for weight in weights]


def cloud(log_weights: list[float]) -> ParticleBelief:
    states = np.arange(3.0 * len(log_weights)).reshape(3, -1)
    return ParticleBelief(Queue((states,)), np.array(log_weights), np.empty((0, 2)))


@given(lists(LOG))
def test_weights_are_a_distribution_with_the_ratios_of_their_logarithms(logs):
    expected = shares_of(logs)
    if not expected:
        assert log_sum_exp(np.array(logs)) == -INF
        return
    seen, log_sum = particles.normalized_with_log_sum(np.array(logs))
    assert seen == pytest.approx(expected, rel=1e-12, abs=1e-300)
    assert (seen >= 0).all()
    assert seen.sum() == pytest.approx(1.0, abs=1e-12)
    effective = particles.effective_sample_size(seen)
    assert effective == pytest.approx(1 / math.fsum(w * w for w in expected))
    total = max(logs) + math.log(math.fsum(math.exp(log - max(logs)) for log in logs))
    assert log_sum_exp(np.array(logs)) == log_sum == pytest.approx(total)


@given(PAIRS, st.booleans())
def test_evidence_of_any_size_makes_a_distribution_or_is_dropped_and_counted(given_logs, is_scan):
    before, factor = given_logs
    belief = cloud(before)
    logs = np.array(factor)
    scan = Scan.of(np.zeros(1), 1.0)
    after = belief.scanned(scan, logs, 256) if is_scan else belief.reweighted(logs)
    expected = shares_of([a + b for a, b in zip(before, factor, strict=True)])
    assert after.events.weight_collapses == (not expected)
    if expected:
        assert after.points()[1] == pytest.approx(expected, rel=1e-12, abs=1e-300)
    else:
        assert after.log_weights.tolist() == before
        assert after.log_evidence == belief.log_evidence


@given(lists(SHARE), lists(LOG))
def test_the_mass_of_a_grid_is_a_distribution_or_none_is_left(shares, logs):
    mass = np.resize(shares, max(len(shares), len(logs)))
    mass = mass / max(mass.sum(), 1e-300)
    mass[mass < grid_motion.EMPTY_CELL] = 0.0
    logs, after = np.resize(logs, mass.size), np.empty(mass.size)
    evidence = grid_motion.reweight(mass, logs, after)
    top = logs[mass > 0].max(initial=-INF)
    assert (evidence == -INF) == (top == -INF)
    if top > -INF:
        with np.errstate(over="ignore"):  # logs - top
            relative = mass * np.exp(np.minimum(logs - top, 0.0))
        assert after == pytest.approx(relative / relative.sum(), rel=1e-9, abs=1e-12)


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3),
    st.lists(st.floats(-1, 1), min_size=3, max_size=3),
    st.lists(st.just(0.0) | st.floats(1e-2, 1), min_size=3, max_size=3),
    st.floats(-6, 6),
)
def test_the_points_of_a_gaussian_have_its_moments_also_where_it_has_no_width(mean, row, sds, size):
    correlated = np.array([[1, 0, 0], [row[0], 1, 0], [row[1], row[2], 1]]) * np.array(sds)[:, None]
    covariance = correlated @ correlated.T * 10.0**size
    centre = np.array(mean)
    scale = np.sqrt(np.trace(covariance)) + 1e-9 * np.abs(centre).max() + 1e-30
    for points in (gaussian_points(centre, covariance), sigma_points(centre, covariance).T):
        apart = (points - centre) / scale
        assert np.abs(apart.mean(axis=0)).max() < 1e-6
        assert apart.T @ apart / len(apart) == pytest.approx(covariance / scale**2, abs=1e-6)


class Same:
    def __init__(self, number: float) -> None:
        self.number = number

    def random(self, size: int | None = None):
        return self.number if size is None else np.full(size, self.number)


@given(lists(SHARE, 1, 20).filter(lambda shares: sum(shares) > 1e-290))
def test_resampling_copies_each_particle_n_w_times_on_average_and_no_weightless_one(shares):
    # A pointer's place is uniform in its stratum, so what it copies on average is found on a grid
    # of 200 places: to 1/200 of a pointer at either end of a particle's interval.
    n, weights = len(shares), np.array(shares) / math.fsum(shares)
    for scheme in SCHEMES.values():
        copies = np.zeros(n)
        for place in (np.arange(200) + 0.5) / 200:
            chosen = scheme(weights, Same(place))
            assert (weights[chosen] > 0).all()
            copies += np.bincount(chosen, minlength=n) / 200
        for extreme in (0.0, math.nextafter(1.0, 0.0)):  # (n - 1 + u) / n is rounded to 1
            assert (weights[scheme(weights, Same(extreme))] > 0).all()
        per_pointer = n if scheme is SCHEMES["multinomial"] else 1
        assert np.abs(copies - n * weights).max() <= per_pointer / 200 + 1e-9


@given(lists(LOG).filter(lambda logs: max(logs) > -INF), st.integers(0, 2**32 - 1))
def test_a_resampled_belief_is_evenly_weighted_and_has_the_evidence_of_before(logs, seed):
    belief = cloud(logs)
    chosen = Resampling().ancestors(belief.weights, np.random.default_rng(seed))
    after = belief.resampled(chosen, log_sum_exp(belief.log_weights))
    n = len(logs)
    assert after.points()[1].tolist() == pytest.approx([1 / n] * n)
    assert set(after.present[0]) <= set(belief.present[0][np.array(logs) > -INF])
    assert after.log_evidence == pytest.approx(belief.log_evidence, rel=1e-9, abs=1e-9)


def counts(chosen: np.ndarray) -> np.ndarray:
    return np.bincount(chosen, minlength=chosen.size)


def random_weights(n: int, rng: np.random.Generator) -> np.ndarray:
    """From nearly equal to nearly all on one, some of them zero."""
    weights = rng.exponential(size=n) ** rng.choice([0.2, 1.0, 8.0]) * (rng.random(n) > 0.2)
    weights[rng.integers(n)] += 0.1
    return weights / weights.sum()


@pytest.mark.parametrize("n", [1, 2, 7, 64, 1000])
def test_a_particle_is_copied_floor_or_ceil_n_w_times_or_within_two_of_n_w_if_stratified(n):
    # n w is rounded: a count may differ where n w is within 1e-9 of a whole number. Of the strata
    # those that a particle's interval covers wholly give one copy each, those at its ends may.
    rng = np.random.default_rng(n)
    for _ in range(200):
        weights = random_weights(n, rng)
        for scheme in SCHEMES.values():
            chosen = scheme(weights, rng)
            assert (np.diff(chosen) >= 0).all()
            assert (weights[chosen] > 0).all()
        copies = counts(particles.systematic(weights, rng))
        assert (copies >= np.floor(n * weights - 1e-9)).all()
        assert (copies <= np.ceil(n * weights + 1e-9)).all()
        assert (np.abs(counts(particles.stratified(weights, rng)) - n * weights) < 2 + 1e-9).all()


def test_systematic_resampling_of_weights_that_are_all_zero_gives_the_first_particle():
    assert particles.systematic(np.zeros(3), np.random.default_rng(0)).tolist() == [0] * 3


def test_multinomial_resampling_has_the_multinomial_variance():
    # n w (1 - w); its estimate from 10,000 draws has a relative standard error of about √(2/10⁴)
    weights, rng = np.array([0.1, 0.2, 0.3, 0.4]), np.random.default_rng(5)
    copies = np.array([counts(SCHEMES["multinomial"](weights, rng)) for _ in range(10_000)])
    assert copies.var(axis=0) == pytest.approx(4 * weights * (1 - weights), rel=5 * 0.015)


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("weights", [[1, 1, 1, 1.0], [1, 2, 3, 4.0], [1, 1e-9, 0, 0.0]])
def test_the_rng_is_used_the_same_whether_or_not_resampling_triggers(name, weights):
    states, scheme = [], SCHEMES[name]
    for strategy in [Resampling(scheme, threshold) for threshold in (None, 0, 0.5, 1)]:
        rng = np.random.default_rng(7)
        with np.errstate(divide="ignore"):
            strategy.ancestors(particles.normalized_with_log_sum(np.log(weights))[0], rng)
        states.append(rng.bit_generator.state)
    assert all(state == states[0] for state in states)
    assert states[0] != np.random.default_rng(7).bit_generator.state


@pytest.mark.parametrize("threshold", [0.0, 0.3, 0.5, 0.9, 1.0])
def test_resampling_triggers_iff_the_effective_sample_size_is_below_the_threshold(threshold):
    rng, seen = np.random.default_rng(9), set()
    for _ in range(200):
        log_weights = np.log(random_weights(20, rng) + 1e-300)
        weights, _ = particles.normalized_with_log_sum(log_weights)
        chosen = Resampling(ess_threshold=threshold).ancestors(weights, rng)
        degenerate = weights.sum() ** 2 / (weights**2).sum() < threshold * 20
        assert (chosen is not None) == degenerate
        seen.add(degenerate)
    assert seen == {0.0: {False}, 1.0: {True}}.get(threshold, {True, False})


def by_the_rule(poses: np.ndarray, weights: np.ndarray, metre: float):
    """Which points count, (n,): those of the heaviest cell and its neighbours."""
    cells = [
        (
            math.floor(x / metre),
            math.floor(y / metre),
            math.floor(math.remainder(heading, 2 * math.pi) / (math.pi / 6)) % 12,
        )
        for x, y, heading in poses.tolist()
    ]
    total: dict[tuple[int, int, int], float] = defaultdict(float)
    for cell, weight in zip(cells, weights.tolist(), strict=True):
        total[cell] += weight
    # of equal ones the first; sectors are counted from -π
    best = min(total, key=lambda cell: (-total[cell], cell[:2], (cell[2] + 6) % 12))
    apart = np.abs(np.array(cells) - best)
    return (apart[:, :2] <= 1).all(axis=1) & np.isin(apart[:, 2], (0, 1, 11))


@settings(max_examples=150)
@given(
    n=st.integers(1, 60),
    # the last two: more cells than a table is for, and more than a float64 counts
    spread=st.sampled_from([0.3, 2.0, 20.0, 1e6, 1e11]),
    equal=st.booleans(),
    unit=st.sampled_from(["m", "px"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_it_is_the_heaviest_cell_and_its_neighbours(n, spread, equal, unit, seed):
    rng, metre = np.random.default_rng(seed), {"m": 1.0, "px": 50.0}[unit]
    poses = rng.normal(0, 1, (n, 3)) * (spread * metre, spread * metre, 2.5)
    poses = poses[rng.integers(n, size=n)].astype(np.float32)  # some cells have several
    weights = np.full(n, 1 / n) if equal else rng.dirichlet(np.full(n, 0.3))
    near = by_the_rule(poses, weights, metre)
    found = best_cluster(poses, weights, unit=unit)
    assert found.share == pytest.approx(weights[near].sum())
    assert found.mean == pytest.approx(mean_pose(poses[near], weights[near] / found.share))


@pytest.fixture
def steady(robot) -> localizers.RobotModel:
    """A robot that turns so little by itself that every particle drives where it is told."""
    return replace(robot, motion=localizers.OdometryMotion(drive=0.1, turn=0.1, drift=0.0005))


@pytest.fixture
def start() -> localizers.GaussianPrior:
    return localizers.GaussianPrior(mean=(50.0, 50.0, 0.0), sd_position=3.0, sd_heading=0.02)


def assert_sound(belief) -> None:
    for offset in range(-6, 7):
        if (points := belief.points(offset)) is not None:
            assert np.isfinite(points[0]).all()
            assert (points[1] >= 0).all()
            assert points[1].sum() == pytest.approx(1.0)


@quietly
@pytest.mark.parametrize("name", ["mcl-map", "mcl-map-smoother", "deq-mcl"])
@pytest.mark.parametrize("ess_threshold", [None, 0.5])
def test_if_all_collide_the_weights_are_those_of_the_scan(steady, start, name, ess_threshold):
    params = {"particles": 50, "ess_threshold": ess_threshold}
    seen = {"scan": [40.0], "action": [-80.0, 0.0], **params}
    collapsed, uncharged = (updated(name, steady, start, beta=b, **seen) for b in (INF, 0))
    assert uncharged.events.weight_collapses == 0
    assert collapsed.events.weight_collapses == 1
    assert np.array_equal(collapsed.points()[1], uncharged.points()[1])
    assert_sound(collapsed)


@quietly
def test_a_scan_model_that_can_be_zero_collapses_and_is_counted(room, start):
    scan = localizers.GaussianUniform(sigma=0.5, uniform=0.0)
    robot = localizers.RobotModel(floor_plan=room, lidar=Lidar(), scan=scan)
    localizer = started("mcl", robot, start, particles=50)
    belief = localizer.update([10.0], [0.0, 0.0], [])  # 300 px seen: z = 580, density 0
    assert belief.events.weight_collapses == 1
    assert belief.points()[1].tolist() == [1 / 50] * 50
    assert localizer.update([300.0], [0.0, 0.0], []).events.weight_collapses == 1


@quietly
@pytest.mark.parametrize("ess_threshold", [None, 0.0, 0.5])
@pytest.mark.parametrize("pilots", [1, 16])
@pytest.mark.parametrize("beta", [200.0, INF])
@pytest.mark.parametrize("planned", [INTO_THE_WALL, np.tile([-25.0, 0.0], (6, 1))])
def test_a_plan_given_up_leaves_sound_weights(steady, start, planned, beta, pilots, ess_threshold):
    # The queued future collides for all particles or many; then another plan is driven.
    params = {"particles": 50, "lag": 3, "beta": beta, "ess_threshold": ess_threshold}
    localizer = localizers.make("deq-mcl", steady, pilots=pilots, **params)
    plans = [planned, *(AHEAD[t:] for t in range(1, 7))]
    beliefs = follow(localizer, start, (AHEAD, SCANS), plans=plans)
    for belief in beliefs:
        assert_sound(belief)
        assert math.isfinite(belief.log_evidence)
    assert beliefs[-1].events.replanned_steps == 1


@quietly
@pytest.mark.parametrize(
    ("name", "params"),
    [
        *(("deq-mcl", {"pilots": pilots}) for pilots in (1, 16)),
        *(("deq-mcl-fresh", {"evidence": evidence}) for evidence in ("plan", "future")),
    ],
    ids=str,
)
@pytest.mark.parametrize("ess_threshold", [None, 0.0, 0.5])
def test_a_new_plan_into_the_wall_leaves_sound_weights(steady, start, name, params, ess_threshold):
    params = {"particles": 50, "lag": 3, "beta": INF, "ess_threshold": ess_threshold, **params}
    localizer = localizers.make(name, steady, **params)
    plans = [AHEAD, AHEAD[1:], *(INTO_THE_WALL[t:] for t in range(2, 7))]
    beliefs = follow(localizer, start, (AHEAD, SCANS), plans=plans)
    for belief in beliefs:
        assert_sound(belief)
    events = beliefs[2].events  # evidence that every particle contradicts is dropped, and counted
    assert events.weight_collapses + events.infeasible_plans >= 1
