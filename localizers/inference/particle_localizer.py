"""The stateful shell around a particle filter: what users hold in their hands."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deqmcl_gym.numerics.types import Singles
from deqmcl_gym.validation import InputError, integer
from localizers.api import Prior, RobotModel, checked_plan, checked_step
from localizers.inference.belief import ParticleBelief
from localizers.inference.particle_filter import ParticleFilter
from localizers.inference.resampling import resampling
from localizers.inference.trust import ANYWHERE, Trust
from localizers.models.feasibility import Unconstrained
from localizers.models.free_space import even_poses
from localizers.models.scan import LidarScan

MAX_PARTICLES = 10_000_000
_BYTES_PER_PARTICLE = 3 * 4 + 8  # one queued pose and its link


class ParticleLocalizer:
    """A ``Localizer`` that runs a ``ParticleFilter``; checks what it is given, counts bad beams."""

    def __init__(self, robot: RobotModel, particle_filter: ParticleFilter) -> None:
        """Make a localizer for ``robot`` out of a filter's parts."""
        self.robot = robot
        self.filter = particle_filter
        self._running: tuple[ParticleBelief, np.random.Generator] | None = None
        _check_size(particle_filter)

    @classmethod
    def plain(
        cls, robot: RobotModel, *, particles: int, resampler: str, ess_threshold: float | None
    ) -> "ParticleLocalizer":
        """Return MCL, the member of the family that all others are varied from."""
        integer("particles", particles, low=1)
        return cls(
            robot,
            ParticleFilter(
                motion=robot.motion,
                scan=LidarScan(floor_plan=robot.floor_plan, lidar=robot.lidar, beam=robot.scan),
                feasibility=Unconstrained(),
                resampling=resampling(resampler, ess_threshold),
                particles=particles,
            ),
        )

    def varied(self, **parts: Any) -> "ParticleLocalizer":
        """Return the localizer with other parts."""
        return ParticleLocalizer(self.robot, replace(self.filter, **parts))

    def reset(self, prior: Prior, plan: ArrayLike, rng: np.random.Generator) -> ParticleBelief:
        """Start anew; see ``Localizer.reset``."""
        belief = self.filter.initial(_Cloud(prior), checked_plan(plan), rng)
        trust = Trust(self.filter.scan, self._anywhere)
        belief = belief._replace(trust=trust)
        self._running = (belief, rng)
        return belief

    def update(self, ranges: ArrayLike, action: ArrayLike, plan: ArrayLike) -> ParticleBelief:
        """Go one step on; see ``Localizer.update``."""
        if self._running is None:
            raise RuntimeError(
                "update was called before reset: call reset(prior, plan, rng) first."
            )
        belief, rng = self._running
        scan, command, ahead, usable = checked_step(ranges, action, plan, self.robot.lidar)
        belief = self.filter.step(belief, scan, command, ahead, rng)
        if usable < scan.size:
            belief = belief._replace(events=belief.events.of_scan(scan.size, usable))
        self._running = (belief, rng)
        return belief

    @cached_property
    def _anywhere(self) -> Singles:
        return even_poses(self.robot.floor_plan, ANYWHERE)


@dataclass(frozen=True)
class _Cloud:
    """A prior over poses as the filter's columns."""

    prior: Prior

    def states(self, n: int, rng: np.random.Generator) -> Singles:
        return np.ascontiguousarray(self.prior.sample(n, rng).T, dtype=np.float32)


def _check_size(particle_filter: ParticleFilter) -> None:
    n, slots = particle_filter.particles, particle_filter.past + 1 + particle_filter.future
    if n > MAX_PARTICLES:
        gibibytes = n * slots * _BYTES_PER_PARTICLE / 2**30
        raise InputError(
            f"particles is {n:,}, which would take {gibibytes:,.0f} GiB; "
            f"allowed are 1 to {MAX_PARTICLES:,}."
        )
