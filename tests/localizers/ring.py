"""A world of five states on a ring, small enough to enumerate γ_t exactly.

γ_t = p(x_0) Π_{s ≤ t+F_t} p(x_s | x_{s-1}, u_s) g(x_{s-1}, x_s) Π_{s ≤ t} p(o_s | x_s) p(π_s | x_s)

A particle filter's unnormalised estimate, exp(log_evidence) Σ W φ, has expectation γ_t(φ) at every
number of particles, however it resamples; p(π_s | x_s) = 1 unless plans are evidence.
"""

import math
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise, product

import numpy as np

from localizers.inference.futures import Foresight, PlanEvidence
from localizers.inference.particle_filter import InformedStart, ParticleFilter
from localizers.inference.particles import Resampling
from localizers.models.scan import Scan

STATES, STEPS = 5, 4
FUTURE, PAST, PARTICLES = 2, 1, 8
PRIOR = np.array([0.4, 0.3, 0.1, 0.1, 0.1])
NOISE = {-1: 0.25, 0: 0.5, 1: 0.25}  # of a step
_MOVES, _CUMULATIVE = np.array(list(NOISE)), np.cumsum(list(NOISE.values()))
SENSOR = np.array(  # p(o | x), row x
    [[0.7, 0.2, 0.1], [0.2, 0.6, 0.2], [0.1, 0.3, 0.6], [0.5, 0.1, 0.4], [0.2, 0.4, 0.4]]
)
OBSERVED = (0, 1, 2, 0)  # o_1 … o_4
# Steps that collide: the wall between 4 and 0, and a hole at 2 that only standing still avoids.
COLLIDES = np.zeros((STATES, STATES), dtype=bool)
COLLIDES[4, 0] = COLLIDES[0, 4] = True
COLLIDES[[0, 1, 3, 4], 2] = True
# Where a step that does not collide ends may cost something, too.
COSTS = np.array([0.0, 0.3, 0.7, 0.1, 0.5])
GRADED = np.where(COLLIDES, 1.0, COSTS)  # of each step

Plan = tuple[int, ...]
RESAMPLING = {"always": Resampling(), "when degenerate": Resampling(ess_threshold=0.5)}


@dataclass(frozen=True)
class Drive:
    """What is carried out, and the plan at each time: the actions after the present one."""

    executed: tuple[int, ...]
    plans: tuple[Plan, ...]  # at t = 0 … 4

    @classmethod
    def as_planned(cls, *actions: int) -> "Drive":
        return cls(actions, tuple(actions[t:] for t in range(STEPS + 1)))

    def commands(self, t: int, future: int) -> Plan:
        """u_1 … u_{t+F_t}."""
        return (*self.executed[:t], *self.plans[t][:future])


AS_PLANNED = Drive.as_planned(1, 1, 2, 1)
CHANGES = {
    "executed differs": Drive((1, 2, 2, 1), ((1, 1, 2, 1), (1, 2, 1), (2, 1), (1,), ())),
    "queued step changes": Drive((1, 2, 2, 1), ((1, 1, 2, 1), (2, 2, 1), (2, 1), (1,), ())),
    "plan grows": Drive((1, 1, 2, 1), ((), (1,), (2, 1), (1,), ())),
    "plan is cut short": Drive((1, 1, 2, 1), ((1, 1, 2, 1), (), (2, 1), (), ())),
    # executed differs and the plan grows at 1; a queued step changes and the plan grows at 2;
    # executed differs and the plan is cut short at 3
    "everything": Drive((2, 1, 0, 1), ((1,), (1, 0), (2, 1), (), ())),
}
DRIVES = {"as planned": AS_PLANNED, **CHANGES}
# Whose plan it is: of one who looks again at every step, of one who stands elsewhere, of nobody
# at the start. "as planned" is that of one who looked once.
AUTHORS = {
    "anew": Drive((1, 2, 2, 1), ((0, 2, 1, 1), (2, 1, 1), (0, 1), (2,), ())),
    "stale": Drive((1, 1, 2, 1), ((2, 0, 2, 2), (0, 2, 2), (2, 2), (2,), ())),
    "none at first": Drive((2, 1, 0, 1), ((), (1, 1, 0), (0, 1), (0,), (1,))),
}


class RingPrior:
    def sample(self, n, rng):
        return np.searchsorted(np.cumsum(PRIOR), rng.random(n))[:, None]


class RingMotion:
    def sample(self, states, action, rng):
        noise = _MOVES[_CUMULATIVE.searchsorted(rng.random(states.shape[1]))]
        return (states + int(action[0]) + noise) % STATES


class RingScan:
    def log_likelihood(self, states, scan):
        return np.log(SENSOR[states[0], int(scan.ranges[0])])


@dataclass(frozen=True)
class RingWalls:
    beta: float
    costs: np.ndarray = field(default_factory=lambda: COLLIDES)  # of each step

    def log_g(self, before, after):
        return -self.beta * self.costs[before[0], after[0]]


@dataclass(frozen=True)
class RingPlans:
    beta: float

    def collisions(self, states, plan, first=0):
        at, count = states[0], np.zeros(states.shape[1], np.int32)
        for k, command in enumerate(plan[:, 0].astype(np.intp)):
            to = (at + command) % STATES
            count += COLLIDES[at, to] * (k >= first)
            at = to
        return count


def transition(command: int, beta: float, costs: np.ndarray = COLLIDES) -> np.ndarray:
    one_step = np.zeros((STATES, STATES))
    for x in range(STATES):
        for noise, share in NOISE.items():
            one_step[x, (x + command + noise) % STATES] += share
    return one_step * np.exp(-beta * costs)


def gamma(t: int, commands: Plan, beta: float, shown=None, costs=COLLIDES) -> np.ndarray:
    """∫ γ_t 1{x_s = i} for s = 0 … t + F_t and each i, by summing over all paths, (s, i).

    ``shown`` is p(π_s | x_s) for s = 0 … t, (t + 1, 5); ``costs`` those of each step, (5, 5).
    """
    moved = transition(0, beta=0.0)  # p(x + k | x)
    g = np.exp(-beta * costs)
    total = np.zeros((len(commands) + 1, STATES))
    for path in product(range(STATES), repeat=len(commands) + 1):
        weight = PRIOR[path[0]]
        for s, command in enumerate(commands, start=1):
            before, after = path[s - 1], path[s]
            weight *= moved[before, (after - command) % STATES] * g[before, after]
            if s <= t:
                weight *= SENSOR[after, OBSERVED[s - 1]]
        if shown is not None:
            weight *= shown[range(t + 1), path[: t + 1]].prod()
        total[range(len(path)), path] += weight
    return total


def likely(plan: Plan, beta: float, first: int = 0) -> list[float]:
    """p(π | x) of each x, the steps before ``first`` not charged."""
    figures = []
    for x in range(STATES):
        places = [(x + sum(plan[:k])) % STATES for k in range(len(plan) + 1)]
        steps = list(pairwise(places))[first:]
        figures.append(math.exp(-beta * sum(COLLIDES[step] for step in steps)))
    return figures


def ring_filter(beta: float, **parts) -> ParticleFilter:
    return ParticleFilter(
        motion=RingMotion(),
        scan=RingScan(),
        feasibility=parts.pop("feasibility", RingWalls(beta)),
        resampling=parts.pop("resampling", Resampling()),
        particles=PARTICLES,
        dtype=np.intp,
        **parts,
    )


deq = partial(ring_filter, past=PAST, future=FUTURE, pilots=1)


def fresh(beta: float, copies=3, **parts) -> ParticleFilter:
    ring = ring_filter(beta, past=PAST, **parts)
    ahead = Foresight(rollout=ring.rollout, steps=FUTURE, copies=copies, weighs=True)
    return replace(ring, lookahead=ahead)


def with_plans(beta: float, steps=FUTURE, new_only=False, **parts) -> ParticleFilter:
    evidence = PlanEvidence(sensor=RingPlans(beta), steps=steps, new_only=new_only)
    return ring_filter(beta, past=PAST, lookahead=evidence, **parts)


def started_by_plan(beta: float, draws=5, **parts) -> ParticleFilter:
    start = InformedStart(evidence=PlanEvidence(sensor=RingPlans(beta)), draws=draws)
    return replace(ring_filter(beta, past=PAST, **parts), start=start)


def informed_throughout(beta: float, **parts) -> ParticleFilter:
    return replace(with_plans(beta, **parts), start=started_by_plan(beta).start)


METHODS = {
    "mcl": lambda beta, **parts: ring_filter(0.0, **parts),
    "past": lambda beta, **parts: ring_filter(0.0, past=PAST, **parts),
    "g": ring_filter,
    "g and past": partial(ring_filter, past=PAST),
    "deq": deq,
    "deq, 2 pilots": partial(deq, pilots=2),
    "deq, 16 pilots": partial(deq, pilots=16),
    "fresh": fresh,
    "fresh, one roll-out": partial(fresh, copies=1),
}
PLANS = {
    "plans": with_plans,
    "plans, to their end": partial(with_plans, steps=None),
    "plans, when new": partial(with_plans, steps=3, new_only=True),
    "start": started_by_plan,
    "start, two draws": partial(started_by_plan, draws=2),
    "start and plans": informed_throughout,
    "start and plans, when new": partial(informed_throughout, steps=2, new_only=True),
}


def looked_ahead(ring: ParticleFilter) -> int:
    """F: of the queue, or of the part that does without one."""
    if isinstance(ring.lookahead, PlanEvidence):  # the present is all it is about
        return 0
    return ring.future or getattr(ring.lookahead, "steps", 0)


def plans_shown(ring: ParticleFilter, drive: Drive) -> np.ndarray | None:
    """p(π_s | x_s) at s = 0 … 4 as this filter is meant to take it, (5, 5); None: it is not."""
    evidence, start, beta = ring.lookahead, ring.start, ring.feasibility.beta
    if not isinstance(evidence, PlanEvidence) and not isinstance(start, InformedStart):
        return None
    figures, read = np.ones((STEPS + 1, STATES)), ()  # what was read of the last plan
    for s, plan in enumerate(drive.plans):
        if s == 0 and isinstance(start, InformedStart):
            figures[s], read = likely(plan, beta), plan
        elif isinstance(evidence, PlanEvidence):
            first, seen = 0, plan[: evidence.steps]
            if evidence.new_only:
                while first < min(len(read) - 1, len(plan)) and read[first + 1] == plan[first]:
                    first += 1
            figures[s], read = likely(seen, beta, first), plan[: max(len(seen), first)]
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
        for offset in range(-ring.past, looked_ahead(ring) + 1):
            if (points := belief.points(offset)) is not None:
                states = points[0][:, 0]
                figures[t, offset] = np.bincount(states, weights=mass, minlength=STATES)
    return figures


def z_scores(ring: ParticleFilter, drive: Drive, replicates: int, costs=COLLIDES) -> dict:
    """(Mean estimate - exact) / standard error, at each (t, offset): one per state, (5,)."""
    runs = [estimates(ring, drive, seed) for seed in range(replicates)]
    scores, shown = {}, plans_shown(ring, drive)
    beta, ahead = ring.feasibility.beta, looked_ahead(ring)
    commands = [drive.commands(t, ahead) for t in range(STEPS + 1)]
    paths = [gamma(t, taken, beta, shown, costs) for t, taken in enumerate(commands)]
    for t, offset in runs[0]:
        exact = paths[t][t + offset]
        seen = np.array([one[t, offset] for one in runs])
        error = seen.std(axis=0, ddof=1) / math.sqrt(replicates)
        # A value never seen must have no weight: an infinite score if it has some.
        with np.errstate(divide="ignore", invalid="ignore"):
            score = (seen.mean(axis=0) - exact) / error
        same = np.isclose(seen.mean(axis=0), exact, rtol=1e-12, atol=0)
        scores[t, offset] = np.where(same, 0.0, score)
    return scores


def worst(scores: dict) -> float:
    return max(float(np.abs(z).max()) for z in scores.values())
