"""The hedge: whose picture is right, by the scans alone, and what a wrong plan can cost."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
import ring
from following import follow, same
from hypothesis import given, settings
from hypothesis import strategies as st

import localizers
from deqmcl_gym.validation import InputError
from localizers.inference.belief import ParticleBelief, Queue
from localizers.inference.hedge import Hedge, mixed, probability_of, switched, weighed
from localizers.models.scan import LidarScan, Scan

N = 60
RNG = np.random.default_rng
SOME = st.floats(-50.0, 20.0)
BETA, SWITCHING, TRUST, MANY = 2.0, 0.2, 0.6, 400_000
# of frequencies of n draws, resampled at each of 4 steps: 5 standard deviations
TOLERANCE = 5 * 0.5 * math.sqrt(5 / MANY)


@settings(max_examples=300)
@given(
    evidence=st.lists(st.tuples(SOME, SOME), min_size=1, max_size=200),
    switching=st.floats(0.0, 0.5),
    trust=st.floats(0.001, 0.999),
)
def test_in_no_sequence_of_scans_is_it_far_behind_either_member(evidence, switching, trust):
    log_odds, total = math.log(trust / (1 - trust)), 0.0
    for pair in evidence:
        log_odds, log_p = weighed(switched(log_odds, switching), *pair)
        total += log_p
    stays = len(evidence) * math.log1p(-switching)
    rounding = 1e-12 * len(evidence) * 100
    advised, protected = np.sum(evidence, axis=0)
    assert total >= advised + math.log(trust) + stays - rounding
    assert total >= protected + math.log1p(-trust) + stays - rounding


def test_what_is_unknown_or_impossible_to_both_moves_no_trust():
    for log_a, log_b in ((math.nan, 0.0), (0.0, math.nan), (-math.inf, -math.inf)):
        log_odds, evidence = weighed(0.3, log_a, log_b)
        assert log_odds == 0.3
        assert math.isnan(evidence)
    doubt = math.log(1 - probability_of(0.3))
    assert weighed(0.3, -math.inf, -2.0) == (-math.inf, pytest.approx(doubt - 2.0))
    assert weighed(math.inf, -math.inf, -2.0) == (math.inf, -math.inf)  # never doubted


def misled(drive, seed):
    rng, steps = RNG(seed), len(drive[0])
    return [rng.normal((20.0, 0.0), (15.0, 0.5), (20, 2)) for _ in range(steps + 1)]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("mutual", [False, True])
def test_whatever_plans_say_scans_stay_likely_but_for_a_constant(robot, prior, drive, seed, mutual):
    params = {"particles": N, "switching": 0.01, "trust": 0.7, "mutual": mutual}
    hedge = localizers.make("mcl-plan-hedged", robot, **params)
    beliefs = follow(hedge, prior, drive, seed, plans=misled(drive, seed))[1:]
    told = sum(belief.scan_log_evidence for belief in beliefs)
    stays = len(beliefs) * math.log(0.99)
    for member, trust in (("advised", 0.7), ("protected", 0.3)):
        alone = sum(getattr(belief, member).scan_log_evidence for belief in beliefs)
        assert told >= alone + math.log(trust) + stays - 1e-9


def test_no_plan_touches_the_protected_member(make, prior, drive):
    params = {"start_draws": 3, "recovery_alpha_fast": 0.5, "scan_keep": 0.2}
    clouds = [
        [b.protected for b in follow(make("mcl-plan-hedged", **params), prior, drive, plans=plans)]
        for plans in (None, misled(drive, 0), [np.empty((0, 2))] * (len(drive[0]) + 1))
    ]
    assert same(clouds[0], clouds[1], offsets=range(-6, 1))
    assert same(clouds[0], clouds[2], offsets=range(-6, 1))


@pytest.mark.parametrize("trust", [0.0, 1.0])
def test_of_members_one_of_which_is_never_doubted_it_is_that_one(make, prior, drive, trust):
    hedge = make("mcl-plan-hedged", switching=0.0, trust=trust)
    beliefs = follow(hedge, prior, drive)
    assert {belief.trusted for belief in beliefs} == {trust}
    member = [belief.advised if trust else belief.protected for belief in beliefs]
    assert same(beliefs, member, offsets=range(-20, 2))
    # its protected member draws what it would draw alone
    alone = follow(make("mcl-map-smoother", particles=N // 2), prior, drive)
    assert same([belief.protected for belief in beliefs], alone, offsets=range(-20, 1))


def test_it_is_both_clouds_with_their_shares(make, prior, drive):
    for belief in follow(make("mcl-plan-hedged"), prior, drive):
        for offset in (-2, 0):
            if (points := belief.points(offset)) is None:
                continue
            poses, weights = points
            advised, protected = belief.advised.points(offset), belief.protected.points(offset)
            assert np.array_equal(poses, np.concatenate([advised[0], protected[0]]))
            assert weights[: N // 2].sum() == pytest.approx(belief.trusted)
            assert weights.sum() == pytest.approx(1.0)
        assert belief.points(1) is None
        assert 0.0 <= belief.quality <= 1.0


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_share_of_a_cloud_is_drawn_from_another_with_whole_paths(share):
    n, m, before = 4000, 500, 2
    weights = RNG(1).random(m)

    def paths(n, base):
        """States that tell which path they are of: row 0, and when: row 1."""
        return Queue.of([np.stack([base + np.arange(n), np.full(n, t)]) for t in range(before + 1)])

    ours = ParticleBelief(paths(n, 0.0), RNG(0).normal(size=n), np.empty((0, 2)))
    other = ParticleBelief(paths(m, 1e6), np.log(weights), np.empty((0, 2)))
    after = mixed(ours, share, other, RNG(2))
    held = [after.queue.at(offset) for offset in range(-before, 1)]
    assert [states[1].tolist() for states in held] == [[float(t)] * n for t in range(before + 1)]
    assert all(np.array_equal(states[0], held[0][0]) for states in held)  # one path each
    new = held[0][0] >= 1e6
    # of n draws: 5 standard deviations, by chance once in 10⁶
    assert abs(new.mean() - share) <= 5 * math.sqrt(share * (1 - share) / n)
    if share == 0.0:
        assert after is ours
        return
    drawn = np.bincount(held[0][0][new].astype(int) - 10**6, minlength=m)
    assert np.abs(drawn - new.sum() * weights / weights.sum()).max() < 1 + 1e-9  # systematic
    assert np.array_equal(after.log_weights[~new], ours.log_weights[~new])
    mean = np.exp(ours.log_weights).mean()
    assert np.exp(after.log_weights[new]) == pytest.approx(np.full(new.sum(), mean))


def two_modes(drive, beta, switching, trust, *, mutual):
    """(q_t, p_A(x_t), p_B(x_t)) of the hedge by summing over all states, t = 0 … 4."""
    q, clouds, told = trust, [ring.PRIOR.copy(), ring.PRIOR.copy()], []
    for t, plan in enumerate(drive.plans):
        if t > 0:
            before, ahead = clouds, q * (1 - switching) + (1 - q) * switching
            share = switching * (1 - q) / ahead
            clouds = [(1 - share) * before[0] + share * before[1], before[1]]
            if mutual:
                share = switching * q / (1 - ahead)
                clouds[1] = (1 - share) * before[1] + share * before[0]
            # the plan's weights were normalised: it moves A's states, not A's evidence
            likelihood = ring.SENSOR[:, ring.OBSERVED[t - 1]]
            step = ring.transition(drive.executed[t - 1], 0.0)
            charged = step * np.exp(-beta * ring.COLLIDES)
            clouds = [cloud @ charged / (cloud @ charged).sum() for cloud in clouds]
            evidence = [(cloud * likelihood).sum() for cloud in clouds]
            clouds = [c * likelihood / e for c, e in zip(clouds, evidence, strict=True)]
            q = ahead * evidence[0] / (ahead * evidence[0] + (1 - ahead) * evidence[1])
        clouds[0] = clouds[0] * ring.likely(plan[: ring.FUTURE], beta)
        clouds[0] /= clouds[0].sum()
        told.append((q, *clouds))
    return told


@pytest.mark.parametrize("mutual", [False, True], ids=["protected", "mutual"])
@pytest.mark.parametrize("author", ["anew", "stale"])
def test_many_particles_are_the_two_modes_enumerated(author, mutual):
    drive = ring.AUTHORS[author]
    made = (one(BETA) for one in (ring.with_plans, ring.METHODS["g and past"]))
    advised, protected = (replace(filter_, particles=MANY) for filter_ in made)
    trust = {"switching": SWITCHING, "trust": TRUST, "mutual": mutual}
    hedge = Hedge(advised=advised, protected=protected, **trust)
    exact = two_modes(drive, BETA, SWITCHING, TRUST, mutual=mutual)
    for belief, (q, *clouds) in zip(ring.beliefs(hedge, drive, seed=0), exact, strict=True):
        assert belief.trusted == pytest.approx(q, abs=TOLERANCE)
        for member, cloud in zip((belief.advised, belief.protected), clouds, strict=True):
            states, weights = member.points()
            found = np.bincount(states[:, 0], weights, ring.STATES)
            assert found == pytest.approx(cloud, abs=TOLERANCE)


@dataclass
class Predicting:
    belief: localizers.Belief
    scan_log_evidence: float

    def points(self, offset=0):
        return self.belief.points(offset)


def test_a_plug_in_that_predicts_scans_can_be_hedged_and_another_is_told(robot, prior, drive):
    class Telling:
        def reset(self, prior, plan, rng):
            self.rng = rng
            return Predicting(localizers.PoseBelief(prior.mean), math.nan)

        def update(self, ranges, action, plan):
            return Predicting(localizers.PoseBelief((50.0, 40.0, 0.0)), -200.0)

    class Silent(Telling):
        def update(self, ranges, action, plan):
            return localizers.PoseBelief((50.0, 40.0, 0.0))

    safe = localizers.make("mcl-map", robot, particles=N)
    beliefs = follow(localizers.hedged(robot, Telling(), safe), prior, drive)
    assert beliefs[-1].trusted < 0.01
    with pytest.raises(InputError, match="scan_log_evidence"):
        follow(localizers.hedged(robot, Silent(), safe), prior, drive)


def test_every_particle_of_both_members_tells_how_well_the_scan_was_predicted(robot, prior, drive):
    # 256 evenly spaced ones elsewhere: the few of a cloud that matter may not be among them
    hedge = localizers.make("mcl-plan-hedged", robot, particles=1200)
    scan = LidarScan(floor_plan=robot.floor_plan, lidar=robot.lidar, beam=robot.scan)
    belief = follow(hedge, prior, (drive[0][:1], drive[1][:1]))[-1]
    member = belief.protected  # a plan read after the scan is in the other's weights, too
    log_likelihood = scan.log_likelihood(member.present, Scan.of(drive[1][0], 400.0))
    before = np.exp(member.log_weights - log_likelihood)
    told = np.log((before * np.exp(log_likelihood)).sum() / before.sum())
    assert member.scan_log_evidence == pytest.approx(told, abs=1e-9)
