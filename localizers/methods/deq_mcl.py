"""Q(t) = p(x_{t-L:t+L} | a_{1:t}, â_{t+1:T}, o_{1:t}, m): DEQ-MCL, as published.

Taniguchi, Fukawa & Yamakawa 2024, eqs. (2)-(3): a queue of past, present and future states; the
planned future is drawn ahead, charged for collisions, and resampled together with the present.
"""

from deqmcl_gym.validation import integer
from localizers.api import RobotModel
from localizers.inference.particle_localizer import ParticleLocalizer
from localizers.methods.smoother import mcl_map_smoother


def deq_mcl(
    robot: RobotModel,
    *,
    particles: int = 1000,
    lag: int = 20,
    beta: float = 10.0,
    pilots: int = 16,
    resampler: str = "systematic",
    ess_threshold: float | None = None,
) -> ParticleLocalizer:
    """Return DEQ-MCL with a queue of ``lag`` = L steps to either side; else as ``mcl_map``.

    Args:
        pilots: M, rollouts per particle when the executed action or the plan differs from what the
            queue was drawn by.
    """
    base = mcl_map_smoother(
        robot,
        particles=particles,
        lag=lag,
        beta=beta,
        resampler=resampler,
        ess_threshold=ess_threshold,
    )
    return base.varied(future=lag, pilots=integer("pilots", pilots, low=1))
