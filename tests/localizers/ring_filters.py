"""Particle filters of the ring, and how far what they say is from what is enumerated."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
from ring_world import (
    FUTURE,
    OBSERVED,
    PARTICLES,
    PAST,
    STATES,
    STEPS,
    Drive,
    Plan,
    RingMotion,
    RingPlans,
    RingPrior,
    RingScan,
    RingTable,
    RingWalls,
    gamma,
    likely,
)

from localizers.inference.futures import RenewedFuture
from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.plan_evidence import (
    DoubtedPlans,
    Pilots,
    PlanEvidence,
    Tabulated,
    nothing_known,
)
from localizers.inference.resampling import Always, WhenDegenerate, by_reported_weight
from localizers.inference.start import InformedStart
from localizers.models.scan import Scan

RESAMPLING = {"always": Always(), "when degenerate": WhenDegenerate(0.5)}


def ring_filter(
    beta: float, filter_class: type[ParticleFilter] = ParticleFilter, **parts
) -> ParticleFilter:
    return filter_class(
        motion=RingMotion(),
        scan=RingScan(),
        feasibility=RingWalls(beta),
        resampling=parts.pop("resampling", Always()),
        particles=PARTICLES,
        dtype=np.intp,
        **parts,
    )


deq = partial(ring_filter, past=PAST, future=FUTURE, pilots=1)


def rejuvenated(beta: float, when=lambda move: move, **parts) -> ParticleFilter:
    ring = deq(beta, **parts)
    return replace(ring, move=when(RenewedFuture(ring.rollout)))


def with_pilots(beta: float, **parts) -> ParticleFilter:
    ring = ring_filter(beta, past=PAST, **parts)
    return replace(ring, lookahead=Pilots(rollout=ring.rollout, steps=FUTURE, pilots=3))


def with_h(beta: float, **parts) -> ParticleFilter:
    table = Tabulated(table=RingTable(beta), steps=FUTURE)
    return ring_filter(beta, past=PAST, lookahead=table, **parts)


def twisted_by_h(beta: float, **parts) -> ParticleFilter:
    return with_h(beta, selection=by_reported_weight, **parts)


def with_plans(beta: float, steps=FUTURE, known=nothing_known, **parts) -> ParticleFilter:
    evidence = PlanEvidence(sensor=RingPlans(beta), steps=steps, known=known)
    return ring_filter(beta, past=PAST, lookahead=evidence, **parts)


def with_doubt(beta: float, switching=0.2, **parts) -> ParticleFilter:
    everywhere = np.arange(STATES)[None]
    doubted = DoubtedPlans(
        sensor=RingPlans(beta), anywhere=everywhere, switching=switching, steps=FUTURE
    )
    return ring_filter(beta, past=PAST, lookahead=doubted, **parts)


def started_by_plan(beta: float, draws=5, **parts) -> ParticleFilter:
    """With plans as evidence, or without: the start alone."""
    start = InformedStart(evidence=PlanEvidence(sensor=RingPlans(beta)), draws=draws)
    return replace(ring_filter(beta, past=PAST, **parts), start=start)


def informed_throughout(beta: float, **parts) -> ParticleFilter:
    return replace(with_plans(beta, **parts), start=started_by_plan(beta).start)


def looked_ahead(ring: ParticleFilter) -> int:
    """F: of the queue, or of the part that does without one."""
    if isinstance(ring.lookahead, PlanEvidence | DoubtedPlans):  # the present is all it is about
        return 0
    return ring.future or getattr(ring.lookahead, "steps", 0)


def plans_shown(ring: ParticleFilter, drive: Drive) -> np.ndarray | None:
    """p(π_s | x_s) at s = 0 … 4 as this filter is meant to take it, (5, 5); None: it is not."""
    evidence, start, beta = ring.lookahead, ring.start, ring.feasibility.beta
    if isinstance(evidence, DoubtedPlans):
        return np.array([likely(plan[: evidence.steps], beta) for plan in drive.plans])
    if not isinstance(evidence, PlanEvidence) and not isinstance(start, InformedStart):
        return None
    figures = np.ones((STEPS + 1, STATES))
    for s, plan in enumerate(drive.plans):
        if s == 0 and isinstance(start, InformedStart):
            figures[s] = likely(plan, beta)
        elif isinstance(evidence, PlanEvidence):
            first, seen = 0, plan[: evidence.steps]
            if s > 0 and evidence.known is not nothing_known:
                whole = s == 1 and isinstance(start, InformedStart)
                last = drive.plans[s - 1][: None if whole else evidence.steps][1:]
                while first < min(len(last), len(seen)) and last[first] == seen[first]:
                    first += 1
            figures[s] = likely(seen, beta, first)
    return figures


def beliefs(ring: ParticleFilter, drive: Drive, seed: int):
    """One filter over the whole drive: its beliefs at t = 0 … 4."""
    rng = np.random.default_rng(seed)

    def column(plan: Plan) -> np.ndarray:
        return np.array(plan, dtype=float).reshape(-1, 1)

    belief = ring.initial(RingPrior(), column(drive.plans[0]), rng)
    yield belief
    for t, action in enumerate(drive.executed, start=1):
        scan = Scan.of(np.array([float(OBSERVED[t - 1])]), 5.0)
        belief = ring.step(belief, scan, np.array([float(action)]), column(drive.plans[t]), rng)
        yield belief


def estimates(ring: ParticleFilter, drive: Drive, seed: int) -> dict[tuple[int, int], np.ndarray]:
    """Unnormalised estimates of one filter at (t, offset), one figure per value of the state."""
    figures = {}
    for t, belief in enumerate(beliefs(ring, drive, seed)):
        mass = math.exp(belief.log_evidence) * belief.weights
        for offset in range(-ring.past, ring.future + 1):
            if (states := belief.queue.at(offset)) is not None:
                figures[t, offset] = np.bincount(states[0], weights=mass, minlength=STATES)
    return figures


def z_scores(
    ring: ParticleFilter, drive: Drive, replicates: int, meant: ParticleFilter | None = None
) -> dict:
    """(Mean estimate - exact) / standard error, at each (t, offset): one per state, (5,).

    What is exact is what the filter ``meant`` aims at, itself if it is None.
    """
    runs = [estimates(ring, drive, seed) for seed in range(replicates)]
    scores, shown = {}, plans_shown(meant or ring, drive)
    switching = getattr((meant or ring).lookahead, "switching", None)
    paths = [
        gamma(t, drive.commands(t, looked_ahead(ring)), ring.feasibility.beta, shown, switching)
        for t in range(STEPS + 1)
    ]
    for t, offset in runs[0]:
        exact = paths[t][t + offset]
        seen = np.array([one[t, offset] for one in runs])
        error = seen.std(axis=0, ddof=1) / math.sqrt(replicates)
        # A value never seen must have no weight: an infinite score if it has some.
        with np.errstate(divide="ignore", invalid="ignore"):
            score = (seen.mean(axis=0) - exact) / error
        scores[t, offset] = np.where(
            np.isclose(seen.mean(axis=0), exact, rtol=1e-12, atol=0), 0.0, score
        )
    return scores


def worst(scores: dict) -> float:
    """Largest |z| of all."""
    return max(float(np.abs(z).max()) for z in scores.values())
