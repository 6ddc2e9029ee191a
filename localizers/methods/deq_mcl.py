"""Q(t) = p(x_{t-L:t+L} | a_{1:t}, â_{t+1:T}, o_{1:t}, m): DEQ-MCL, as published.

Taniguchi, Fukawa & Yamakawa 2024, eqs. (2)-(3): a queue of past, present and future states; the
planned future is drawn ahead, charged for collisions, and resampled together with the present.
"""

from dataclasses import replace

from deqmcl_gym.validation import integer
from localizers.api import RobotModel
from localizers.inference.particle_filter import ParticleFilter
from localizers.methods.family import Shared, method
from localizers.methods.smoother import mcl_map_smoother


@method(*mcl_map_smoother.takes)
def deq_mcl(robot: RobotModel, shared: Shared, *, pilots: int = 16) -> ParticleFilter:
    """Return DEQ-MCL with a queue of ``lag`` = L steps to either side.

    Args:
        robot, shared: see ``Shared``.
        pilots: M, rollouts per particle when the executed action or the plan differs from the
            actions that the queue was drawn with.
    """
    base = mcl_map_smoother.build(robot, shared)
    return replace(base, future=shared.lag, pilots=integer("pilots", pilots, low=1))
