"""The first fix from a single scan without learning, and MCL on the map from there.

CBGL (Filotheou 2024, arXiv 2307.14247): many poses are drawn, ranked by the cumulative absolute
error CAER(x) = Σ_b |o_b - min(ô_b(x), max_range)| of usable beams, and the best few are matched to
the map, here by climbing down that error, as GMapping does (Grisetti, Stachniss & Burgard 2007).
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from deqmcl_gym.maps import Lidar, Map
from deqmcl_gym.maps.map import pixel
from deqmcl_gym.numerics import Floats, Singles, arrays
from deqmcl_gym.validation import integer, number
from localizers.api import Prior
from localizers.inference.belief import ParticleBelief, Queue
from localizers.inference.particle_filter import MAX_PARTICLES, ParticleFilter
from localizers.inference.particles import Action, Actions, States, log_evidence
from localizers.methods.deq_mcl import ON_THE_MAP, Shared, mcl, mcl_map, method
from localizers.models import RobotModel
from localizers.models.scan import Scan, in_blocks


@dataclass(frozen=True, kw_only=True)
class AbsoluteError:
    """Σ over usable beams of |o - min(ô, max_range)|, CAER; inf where the robot does not fit."""

    floor_plan: Map
    lidar: Lidar
    radius: float = 0.0

    def __call__(self, states: States, scan: Scan) -> Floats:
        """Error of each pose (3, n), in the map's unit, (n,)."""
        measured = scan.ranges[scan.usable][:, None]

        def off(block: States) -> Floats:
            some = np.ascontiguousarray(block, np.float32)
            expected = np.empty((scan.beams, some.shape[1]), np.float32)
            self.lidar.cast(self.floor_plan.cast, some, expected, scan.usable)
            seen = np.minimum(expected, self.lidar.max_range)
            error = np.abs(measured - seen).sum(axis=0)
            fits = self.floor_plan.free(some.T, self.radius) & ~np.isnan(error)
            return np.where(fits, error, math.inf)

        return in_blocks(off, states)

    def matched(self, states: States, scan: Scan) -> tuple[Singles, Floats]:
        """Return poses (3, n), each climbed down its error, and the errors, (n,), none grown.

        A pose takes the best of six steps, or halves its steps if none is better.
        """
        step = 25.0 * pixel(self.floor_plan.unit)
        poses, error = arrays.compass_search(
            lambda poses: self(poses.T, scan),
            np.array(states, np.float32).T,
            (step, step, 0.2),
            halvings=6,
            most=60,
            moved=_moved,
        )
        return np.ascontiguousarray(poses.T), error


def _moved(poses: Singles, steps: Floats) -> Singles:
    """Return poses (n, 3) after steps ahead, to the left, and a turn, (n, 3); not wrapped."""
    x, y, heading = np.asarray(poses, np.float64).T
    ahead, left, turn = steps.T
    cosine, sine = arrays.cos(heading), arrays.sin(heading)
    moved = [x + ahead * cosine - left * sine, y + ahead * sine + left * cosine, heading + turn]
    return np.array(moved, np.float32).T


@dataclass(frozen=True, kw_only=True)
class FirstFix:
    """A particle filter that starts where the first scan fits best.

    The belief before the first scan is the cloud of hypotheses, moved by the commands. Then the
    tracker's particles are put around the best of them, and weighed by that scan; the evidence
    recorded for it is that of the hypotheses.
    """

    tracker: ParticleFilter
    error: AbsoluteError
    poses: int  # K; for these see ``cbgl``
    matched: int  # k
    modes: int
    spread: float
    spread_heading: float

    def initial(self, prior: Prior, plan: Actions, rng: np.random.Generator) -> ParticleBelief:
        """Return the belief at t = 0: draws from the prior. The plan is not used."""
        hypotheses = replace(self.tracker, particles=self.poses)
        return hypotheses.initial(prior, plan, rng)._replace(fixed=False)

    def step(
        self,
        belief: ParticleBelief,
        scan: Scan,
        action: Action,
        plan: Actions,
        rng: np.random.Generator,
    ) -> ParticleBelief:
        if belief.fixed:
            return self.tracker.step(belief, scan, action, plan, rng)
        states = self.tracker.motion.sample(belief.present, action, rng)
        belief = belief._replace(queue=Queue((states,)))
        if scan.beams == 0:
            return belief
        fixes = self.fixes(states, scan)
        if fixes.shape[1] == 0:  # no hypothesis is where the robot fits
            return belief
        most = self.tracker.predictive
        some = np.ascontiguousarray(states[:, :: (self.poses - 1) // most + 1])
        likelihoods = self.tracker.scan.log_likelihood(some, scan)
        evidence = log_evidence(np.zeros(likelihoods.size), likelihoods, most)
        n = self.tracker.particles
        sd = np.array([self.spread, self.spread, self.spread_heading])
        around = fixes[:, np.arange(n) % fixes.shape[1]]  # in turn
        cloud = np.ascontiguousarray(
            around + sd[:, None] * rng.standard_normal((3, n)), self.tracker.dtype
        )
        fixed = belief._replace(
            queue=Queue((cloud,)), log_weights=np.zeros(cloud.shape[1]), fixed=True
        )
        likelihoods = self.tracker.scan.log_likelihood(cloud, scan)
        return fixed.reweighted(likelihoods).learned(scan, evidence)

    def fixes(self, states: States, scan: Scan) -> Singles:
        """Return the best of hypotheses (3, K), matched, best first, (3, modes) or fewer."""
        error = self.error(states, scan)
        chosen = np.argsort(error, kind="stable")[: self.matched]
        chosen = chosen[np.isfinite(error[chosen])]
        poses, error = self.error.matched(states[:, chosen], scan)
        return poses[:, np.argsort(error, kind="stable")[: self.modes]]


@method(*mcl.takes, "beta", *ON_THE_MAP, "recovery_alpha_slow", "recovery_alpha_fast")
def cbgl(
    robot: RobotModel,
    shared: Shared,
    *,
    poses: Annotated[int, "poses drawn from the prior and ranked by the first scan"] = 100_000,
    matched: Annotated[int, "of these the best, matched to the map; 1 to poses"] = 10,
    modes: Annotated[int, "of these the best, where MCL starts; 1 (as published) to matched"] = 1,
    spread: Annotated[
        float | None, "SD in x and y, in the map's unit, that it starts with; None: 0.25 m"
    ] = None,
    spread_heading: Annotated[float, "SD of the heading, rad, that it starts with"] = 0.1,
) -> FirstFix:
    """Return MCL on the map that starts at the pose where the first scan has the least error.

    Until the first scan the belief is ``poses`` draws from the prior; at it they are ranked, and
    then forgotten. A wrong fix is only found again by random poses: see ``recovery_alpha_slow``.
    ``beam_filter`` counts from the second scan on.
    """
    px = pixel(robot.floor_plan.unit)
    poses = integer("poses", poses, low=1, high=MAX_PARTICLES)
    matched = integer("matched (of the poses that are drawn)", matched, low=1, high=poses)
    modes = integer("modes (of the poses that are matched)", modes, low=1, high=matched)
    error = AbsoluteError(floor_plan=robot.floor_plan, lidar=robot.lidar, radius=robot.radius)
    return FirstFix(
        tracker=mcl_map.build(robot, shared),
        error=error,
        poses=poses,
        matched=matched,
        modes=modes,
        spread=12.5 * px if spread is None else number("spread", spread, low=0),
        spread_heading=number("spread_heading", spread_heading, low=0),
    )
